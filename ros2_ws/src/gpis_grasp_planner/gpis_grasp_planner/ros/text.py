"""Text from outside, made safe for logs and messages."""

from __future__ import annotations

import re

FRAME_PATTERN = re.compile(r"[A-Za-z0-9_~/][A-Za-z0-9_./~:-]{0,254}", re.ASCII)


def printable(value: object, limit: int = 120) -> str:
    """Text with control characters and everything beyond ASCII escaped, cut at `limit`.

    A mesh ID with a newline in it must not be able to forge a line of the log.
    """
    text = str(value)[: limit + 1].encode("unicode_escape").decode("ascii")
    return text if len(text) <= limit else f"{text[: limit - 3]}..."
