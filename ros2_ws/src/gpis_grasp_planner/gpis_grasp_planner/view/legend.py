"""Words in a picture: a caption over it, a legend of colours beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Pixels = NDArray[np.uint8]

_INK = (30, 30, 35)


def with_caption(pixels: Pixels, caption: str) -> Pixels:
    """Write below the picture's upper edge."""
    image = Image.fromarray(pixels)
    height = max(14, pixels.shape[0] // 26)
    margin = height // 2
    ImageDraw.Draw(image).multiline_text((margin, margin), caption, fill=_INK, font=_font(height))
    return np.asarray(image)


def with_legend(
    pixels: Pixels, title: str, entries: Sequence[tuple[tuple[int, int, int], str]]
) -> Pixels:
    """Add a white column to the right: a title, then a dot of a colour and a text for each entry.

    Returns
    -------
    pixels : (h, w', 3) uint8 array
        Wider by what the longest text needs.
    """
    high = pixels.shape[0]
    height = int(np.clip(high // (len(entries) + 4), 9, max(11, high // 42)))
    font, step, dot = _font(height), round(1.6 * height), round(0.7 * height)
    lines = title.splitlines()
    longest = max(font.getlength(text) for text in (*lines, *(text for _, text in entries)))
    column = Image.new("RGB", (round(longest) + 4 * dot, high), (255, 255, 255))
    draw = ImageDraw.Draw(column)
    y = dot
    for text in lines:
        draw.text((dot, y), text, fill=_INK, font=font)
        y += step
    for color, text in entries:
        draw.ellipse((dot, y + 2, 2 * dot, y + 2 + dot), fill=color)
        draw.text((3 * dot, y), text, fill=_INK, font=font)
        y += step
    return np.hstack([pixels, np.asarray(column)])


def _font(height: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=height)
