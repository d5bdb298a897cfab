"""Defects in pictures drawn here, pixel by pixel: where, how large, what kind."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pips_drake.cable_robot.detection import Detector, find_defects, relative_brightness
from pips_drake.errors import InputError

SIZE = (240, 320)


def background(seed: int = 0) -> np.ndarray:
    """Grey that changes slowly, with noise, by one part in a hundred."""
    rows, columns = np.indices(SIZE)
    slow = 150.0 * (1.0 + 0.1 * np.sin(columns / 90.0) + 0.05 * np.cos(rows / 70.0))
    return slow + np.random.default_rng(seed).normal(0.0, 1.5, SIZE)


def disc(centre, radius, fine: int = 5) -> np.ndarray:
    """Share of each pixel that a disc covers."""
    step = (np.arange(fine) + 0.5) / fine - 0.5
    rows, columns = np.indices(SIZE)
    inside = [
        np.hypot(columns + a - centre[0], rows + b - centre[1]) < radius for a in step for b in step
    ]
    return np.mean(inside, axis=0)


def finished(grey) -> np.ndarray:
    return np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("contrast", [-0.5, -0.2, 0.2, 0.5])
@pytest.mark.parametrize("radius", [2.7, 4.5, 18.0])  # 3, 5 and 20 mm at 1 m
def test_discs_are_found_where_and_as_large_as_they_were_drawn(radius, contrast):
    centre = np.array([150.3, 97.6])
    (found,) = find_defects(finished(background() * (1.0 + contrast * disc(centre, radius))))
    # A quarter of a pixel: noise of 1 % beside a contrast of 20 %.
    np.testing.assert_allclose(found.centre, centre, atol=0.25)
    # Between corners of whole pixels: up to half a pixel more at either end, or one less.
    assert found.extent == pytest.approx(2.0 * radius, abs=1.5)
    assert found.width <= found.extent and not found.cut
    assert found.contrast == pytest.approx(contrast, abs=0.06)
    assert found.kind != "scratch"


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_found_where_nothing_is(seed):
    assert find_defects(finished(background(seed))) == []


def test_seams_and_shades_of_strips_are_no_defects():
    grey = background(1)
    grey[:, 100:190] *= 1.04
    grey[:, 188:191] *= 0.97
    assert find_defects(finished(grey)) == []


@pytest.mark.parametrize("width", [1.4, 2.5])  # 0.8 and 1.4 mm at 1 m
def test_a_thin_scratch_is_one_finding_and_called_a_scratch(width):
    rows, columns = np.indices(SIZE)
    along = (columns - 160.0) * np.cos(0.6) + (rows - 120.0) * np.sin(0.6)
    across = (rows - 120.0) * np.cos(0.6) - (columns - 160.0) * np.sin(0.6)
    shade = np.clip(0.5 * width + 0.5 - np.abs(across), 0.0, 1.0)
    shade *= np.clip(20.5 - np.abs(along), 0.0, 1.0)
    (found,) = find_defects(finished(background(2) * (1.0 + 0.3 * shade)))
    assert found.kind == "scratch" and found.extent == pytest.approx(40.0, abs=2.0)
    np.testing.assert_allclose(found.centre, [160.0, 120.0], atol=0.5)


def test_a_dark_rim_round_a_light_middle_is_one_ding():
    centre = (200.4, 60.2)
    rim, middle = disc(centre, 9.0), disc(centre, 5.0)
    (found,) = find_defects(finished(background(3) * (1.0 - 0.4 * rim + 0.6 * middle)))
    assert found.kind == "ding" and found.extent == pytest.approx(18.0, abs=1.5)
    np.testing.assert_allclose(found.centre, centre, atol=0.4)


def test_dark_debris_is_called_debris_and_stronger_contrasts_come_first():
    grey = background(4)
    grey *= 1.0 - 0.25 * disc((80.0, 120.0), 10.0)
    grey *= 1.0 - 0.5 * disc((240.0, 120.0), 7.0)
    found = find_defects(finished(grey))
    assert [d.kind for d in found] == ["debris", "debris"]
    assert found[0].centre[0] > 200.0 > found[1].centre[0]


def test_what_the_rim_or_the_mask_cuts_says_so():
    grey = background(5) * (1.0 - 0.4 * disc((319.0, 100.0), 8.0) - 0.4 * disc((50, 50), 6.0))
    cut = {round(float(d.centre[0])) > 200: d.cut for d in find_defects(finished(grey))}
    assert cut == {True: True, False: False}
    mask = np.ones(SIZE, dtype=bool)
    mask[:, :50] = False
    (left, _) = sorted(find_defects(finished(grey), None, mask), key=lambda d: d.centre[0])
    assert left.cut and left.outline[:, 0].min() >= 49.5
    mask[:, :70] = False
    assert len(find_defects(finished(grey), None, mask)) == 1
    assert find_defects(finished(grey), None, np.zeros(SIZE, dtype=bool)) == []


def test_what_the_mask_leaves_out_is_no_background():
    grey, mask = background(6), np.ones(SIZE, dtype=bool)
    grey[:, 250:] = 30.0
    grey[200:] = 250.0
    mask[:, 240:] = mask[190:] = False
    assert find_defects(finished(grey), None, mask) == []
    relative = relative_brightness(finished(grey), Detector(), mask)
    assert np.abs(relative[mask]).max() < 0.08  # five deviations of noise and the slow change


def test_a_grey_picture_gives_what_a_coloured_one_gives():
    picture = finished(background(7) * (1.0 - 0.4 * disc((90.0, 90.0), 6.0)))
    (coloured,), (grey,) = find_defects(picture), find_defects(picture[..., 0])
    np.testing.assert_allclose(coloured.centre, grey.centre, atol=1e-3)  # single precision


def test_missing_libraries_and_bad_pictures_are_told_in_one_line(monkeypatch):
    with pytest.raises(InputError, match=r"picture = 20 x 20 pixels; must be 32 x 32 at"):
        find_defects(np.zeros((20, 20), dtype=np.uint8))
    with pytest.raises(InputError, match="detector window = 4; must be odd"):
        Detector(window=4)
    monkeypatch.setitem(sys.modules, "skimage", None)
    with pytest.raises(InputError, match=r"pip install 'pips-drake\[survey\]'"):
        find_defects(np.zeros(SIZE, dtype=np.uint8))
