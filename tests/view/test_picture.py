"""Pictures: everything that should be seen is seen, and the same scene gives the same pixels."""

import numpy as np
import pytest
from PIL import Image

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.view.picture import GraspView, render_grasp, render_sheet
from gpis_grasp_planner.view.shapes import slab

SIZE = (240, 180)


def render(grasp, **options):
    return render_grasp(
        grasp.mesh,
        grasp.hand,
        grasp.T_object_palm,
        grasp.joints,
        options.pop("contacts", grasp.contacts),
        size=SIZE,
        **options,
    )


def shares(pixels):
    """Shares of the picture that are warm (the part), dark or bluish (the hand) and red."""
    r, g, b = (pixels[..., i].astype(int) for i in range(3))
    red = (r > 140) & (g < 70) & (b < 70)
    warm = (r > b + 40) & ~red & (g > b)
    hand = (r < 185) & (np.abs(r - g) < 30) & (r <= b + 5)
    return warm.mean(), hand.mean(), red.mean()


@pytest.mark.parametrize("view", ["auto", "front", "iso"])
def test_hand_and_part_are_both_seen_and_do_not_fill_the_picture(grasp, view):
    pixels = render(grasp, view=view)
    assert pixels.shape == (SIZE[1], SIZE[0], 3)
    assert pixels.dtype == np.uint8
    warm, hand, _ = shares(pixels)
    assert warm > 0.02
    assert hand > 0.10
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]]).astype(int)
    assert border.min() > 150  # nothing but background touches the edge


def test_contacts_are_marked_in_red_and_nothing_else_changes(grasp):
    marked = render(grasp, view="front").astype(int)
    plain = render(grasp, view="front", contacts=None).astype(int)
    changed = (marked != plain).any(axis=2)
    assert 0.002 < changed.mean() < 0.05
    redness = (marked - plain)[changed] @ (2, -1, -1)
    assert (redness > 0).all()
    assert shares(marked)[2] > 0.0 == shares(plain)[2]


def test_the_same_scene_gives_the_same_pixels(grasp):
    np.testing.assert_array_equal(render(grasp), render(grasp))


def test_the_file_holds_the_returned_pixels(grasp, tmp_path):
    pixels = render(grasp, path=tmp_path / "grasp.png")
    with Image.open(tmp_path / "grasp.png") as image:
        assert image.format == "PNG"
        np.testing.assert_array_equal(np.asarray(image), pixels)


def test_the_hand_alone_shows_no_part(grasp):
    pixels = render_grasp(None, grasp.hand, np.eye(4), np.zeros(8), size=SIZE)
    warm, hand, red = shares(pixels)
    assert hand > 0.10
    assert warm == red == 0.0


def test_a_caption_is_written_at_the_top_and_nowhere_else(grasp):
    plain, captioned = render(grasp), render(grasp, caption="mug")
    changed = (plain != captioned).any(axis=2)
    assert changed.any()
    assert not changed[SIZE[1] // 5 :].any()


def test_a_sheet_places_each_grasp_in_its_cell(grasp):
    alone = GraspView(None, grasp.hand, np.eye(4), np.zeros(8))
    sheet = render_sheet([grasp, alone, grasp], columns=2, size=(120, 90))
    assert sheet.shape == (180, 240, 3)
    np.testing.assert_array_equal(sheet[:88, :118], sheet[90:178, :118])
    assert (sheet[90:, 120:] == 255).all()  # no fourth grasp
    assert shares(sheet[:90, :120])[0] > 0.02
    assert shares(sheet[:90, 120:])[0] == 0.0


def test_misuse_is_refused(grasp):
    with pytest.raises(RequestError, match=r"'sideways'.*auto"):
        render(grasp, view="sideways")
    with pytest.raises(RequestError, match="at least one"):
        render_sheet([])


def test_the_table_and_the_way_are_drawn_and_the_camera_frames_the_way(grasp):
    table = slab(transform(np.eye(3), (0.0, 0.0, -0.045)), [0.4, 0.4, 0.01])
    plain = render(grasp, view="iso").astype(int)
    approach = 0.1 * grasp.T_object_palm[:3, 2]
    whole = render(grasp, view="iso", around=[table], approach=approach).astype(int)

    def green(image):
        return (image[..., 1] > image[..., 0] + 40) & (image[..., 1] > image[..., 2] + 40)

    assert not green(plain).any()
    assert 0.001 < green(whole).mean() < 0.05
    rows = np.flatnonzero(green(whole).any(axis=1))
    assert 0 < rows.min() < 0.1 * SIZE[1]
    # Where the part alone has background below it there is the table now.
    assert np.abs(whole[-1] - plain[-1]).mean() > 8
