"""The map of defects: places within the predicted error, merging, recall, wrong maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.defect_map import (
    Finding,
    MapCheck,
    Sighting,
    compare_with_truth,
    locate,
    match,
    merge,
    panel_mask,
    predicted_error,
)
from pips_drake.cable_robot.defects import Defect, defect_patches, next_mission, seeded_defects
from pips_drake.cable_robot.detection import Detection, find_defects
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import panel_points, radiator_panels
from pips_drake.cable_robot.raster import raster_cameras, survey_raster
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    noise_tile,
    view_pose,
    with_noise,
    world_pixels,
)
from pips_drake.cable_robot.survey_comparison import compare_surveys
from pips_drake.errors import InputError

from .survey_scene import Shoot, painted

PANELS = radiator_panels()
CAMERA = SurveyCamera()
#: One panel of each side.
SURVEYED = (PANELS[1], PANELS[6])
RASTER = survey_raster(SURVEYED, CAMERA)
VIEWS = raster_cameras(RASTER, CAMERA)
DEFECTS = seeded_defects(7, SURVEYED, 80)
#: Bounds of the errors of the camera's pose in each direction, m and rad.
POSITION, ROTATION = 1.0e-3, 1.0e-3
ERROR = predicted_error(
    CAMERA, 1.0, position_error=3**0.5 * POSITION, rotation_error=3**0.5 * ROTATION
)


def disturbed(poses: Poses, seed: int, shift: tuple[float, float, float] = (0, 0, 0)) -> Poses:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.uniform(-ROTATION, ROTATION, (len(poses), 3))).as_matrix()
    step = rng.uniform(-POSITION, POSITION, (len(poses), 3))
    return Poses(poses.position + step + shift, turn @ poses.rotation)


def outline_points(defect: Defect) -> np.ndarray:
    """The defect's middle and the corners of its patches, in the world."""
    outline = np.concatenate([patch.points for patch in defect_patches(defect)])
    panel = next(p for p in PANELS if p.name == defect.panel)
    return panel_points(panel, np.concatenate([[[defect.u, defect.v]], outline]))


POINTS = [outline_points(d) for d in DEFECTS]


def projected(poses: Poses, index: int) -> list[Detection]:
    """What a perfect detector says of a picture: outlines projected, cut off at the rim."""
    found = []
    for defect, points in zip(DEFECTS, POINTS, strict=True):
        if np.linalg.norm(points[0] - poses.position[index]) > 1.5:
            continue
        pixels = world_pixels(CAMERA, poses, index, points)
        inside = CAMERA.in_picture(pixels)
        if inside[0]:
            corners = pixels[1:][inside[1:]]
            hull = corners[ConvexHull(corners).vertices]
            found.append(detection(pixels[0], hull, cut=not inside.all(), kind=defect.kind))
    return found


def detection(centre, outline, *, cut: bool = False, kind: str = "debris") -> Detection:
    return Detection(centre, outline, 1.0, 1.0, 1, -0.3, kind, cut)


def mapped(
    true: Poses,
    change: Callable[[Detection], Detection] = lambda d: d,
    tolerance: float = ERROR,
) -> MapCheck:
    """A survey with a perfect detector, from poses that are thought to be the raster's."""
    sightings = []
    for k in range(len(RASTER)):
        seen = [change(d) for d in projected(true, k)]
        sightings += locate(seen, CAMERA, VIEWS, k, PANELS)
    return compare_with_truth(merge(sightings, CAMERA, radius=2.0 * ERROR), DEFECTS, tolerance)


def test_with_known_poses_the_map_is_the_truth():
    check = mapped(VIEWS)
    assert not check.missed and not check.false_alarms
    assert check.errors.max() < 1e-9
    # A curved shape's outline is measured in (u, v), as it was made.
    whole = [f.size_m - d.size_m for f, d in check.pairs if not f.cut]
    assert len(whole) > 75 and np.abs(whole).max() < 1e-3 * 0.04  # a ding's 24 corners


def test_with_disturbed_poses_places_are_within_the_predicted_error():
    check = mapped(disturbed(VIEWS, 1))
    assert check.recall(0.0) == 1.0 and not check.false_alarms
    assert 0.2 * ERROR < check.errors.max() < ERROR  # a bound, and not a loose one


def test_a_mirrored_or_a_shifted_map_fails():
    flipped = [CAMERA.width - 1.0, 0.0], [-1.0, 1.0]

    def mirrored(d: Detection) -> Detection:
        start, sign = np.array(flipped[0]), np.array(flipped[1])
        return replace(d, centre=start + sign * d.centre, outline=start + sign * d.outline)

    def upside_down(d: Detection) -> Detection:
        start, sign = np.array([0.0, CAMERA.height - 1.0]), np.array([1.0, -1.0])
        return replace(d, centre=start + sign * d.centre, outline=start + sign * d.outline)

    for change in (mirrored, upside_down):
        check = mapped(VIEWS, change)
        assert check.recall() < 0.2 and len(check.false_alarms) > 50
    # By one and a half times the predicted error.
    shifted = mapped(disturbed(VIEWS, 1, (1.5 * ERROR, 0.0, 0.0)))
    assert shifted.recall() < 0.5
    # A wider tolerance pairs them, and then says which way the map is off: the camera is farther
    # aft than it is thought to be, so what it sees is taken to be farther forward.
    wide = mapped(disturbed(VIEWS, 1, (1.5 * ERROR, 0.0, 0.0)), tolerance=4.0 * ERROR)
    assert wide.recall() == 1.0
    np.testing.assert_allclose(wide.offsets.mean(axis=0), [-1.5 * ERROR, 0.0], atol=0.2 * ERROR)


def test_the_map_of_the_other_side_fails():
    swapped = [
        replace(d, panel=d.panel.replace("port", "x").replace("starboard", "port")) for d in DEFECTS
    ]
    swapped = [replace(d, panel=d.panel.replace("x", "starboard")) for d in swapped]
    sightings = []
    for k in range(len(RASTER)):
        sightings += locate(projected(VIEWS, k), CAMERA, VIEWS, k, PANELS)
    check = compare_with_truth(merge(sightings, CAMERA, radius=2 * ERROR), swapped, ERROR)
    assert check.recall(0.0) == 0.0


def test_the_predicted_error_bounds_what_poses_at_their_bounds_do():
    rng = np.random.default_rng(3)
    panel = PANELS[4]
    poses = camera_poses(CAMERA, *view_pose(CAMERA, panel, 2.0, 1.6))
    pixels = rng.uniform(0.0, [CAMERA.width - 1.0, CAMERA.height - 1.0], (30, 2))
    pixels[:4] = [[0, 0], [1279, 0], [0, 959], [1279, 959]]
    seen = [detection(p, p + np.array([[0, 0], [1, 0], [0, 1]])) for p in pixels]
    worst, bound = (
        0.0,
        predicted_error(CAMERA, 1.0, position_error=2e-3, rotation_error=2e-3, pixels=0.0),
    )
    true = np.array([s.uv for s in locate(seen, CAMERA, poses, 0, PANELS)])
    for _ in range(30):
        step, turn = (v / np.linalg.norm(v) * 2e-3 for v in rng.normal(size=(2, 3)))
        moved = Poses(
            poses.position + step, Rotation.from_rotvec(turn).as_matrix() @ poses.rotation
        )
        found = np.array([s.uv for s in locate(seen, CAMERA, moved, 0, PANELS)])
        worst = max(worst, float(np.linalg.norm(found - true, axis=1).max()))
    assert 0.5 * bound < worst < bound


def sighting(u: float, v: float, image: int, *, cut: bool = False, size: float = 0.01) -> Sighting:
    return Sighting(
        panel="port_1",
        uv=np.array([u, v]),
        size_m=size,
        width_m=0.5 * size,
        contrast=-0.3,
        kind="debris",
        cut=cut,
        image=image,
        pixel=np.array([100.0 + image, 100.0]),
        distance=1.0,
    )


def test_sightings_within_the_radius_are_one_finding_and_others_are_not():
    seen = [sighting(1.0, 1.0, 0), sighting(1.004, 1.0, 1), sighting(1.02, 1.0, 0)]
    findings = merge(seen, CAMERA, radius=0.008)
    assert [(f.name, f.images) for f in findings] == [("port_1-001", (0, 1)), ("port_1-002", (0,))]
    assert findings[0].u == pytest.approx(1.002) and findings[0].spread == pytest.approx(0.002)
    assert findings[0].image == 1  # nearer to the picture's middle


def test_a_part_at_the_rim_belongs_to_the_whole_that_another_picture_shows():
    whole, part = sighting(1.0, 1.0, 0, size=0.04), sighting(1.012, 1.0, 1, cut=True, size=0.015)
    (finding,) = merge([part, whole], CAMERA, radius=0.008)
    assert (finding.size_m, finding.u, finding.cut) == (0.04, 1.0, False)
    assert finding.images == (0, 1)
    (alone,) = merge([part], CAMERA, radius=0.008)
    assert alone.cut


def test_matching_gives_as_many_pairs_as_there_can_be_with_the_least_sum():
    rng = np.random.default_rng(5)
    for _ in range(30):
        a, b = rng.uniform(0.0, 1.0, (6, 2)), rng.uniform(0.0, 1.0, (7, 2))
        apart = np.linalg.norm(a[:, None] - b[None], axis=2)
        pairs = match(a, b, 0.3)
        assert all(apart[i, k] <= 0.3 for i, k in pairs)
        assert len({i for i, _ in pairs}) == len({k for _, k in pairs}) == len(pairs)
        rows, columns = linear_sum_assignment((apart > 0.3).astype(float))
        most = int((apart[rows, columns] <= 0.3).sum())
        assert len(pairs) == most
    assert match([[0.0, 0.0]], np.empty((0, 2)), 0.3) == []


def test_recall_and_false_alarms_are_counted_by_size():
    sizes = [0.002, 0.004, 0.006, 0.008, 0.03]
    truth = [
        Defect(kind="debris", panel="port_1", u=0.5 * k, v=1.0, size_m=s, width_m=s)
        for k, s in enumerate(sizes, 1)
    ]
    seen = [sighting(0.5 * k, 1.001, 0, size=s) for k, s in enumerate(sizes, 1) if k not in (2, 3)]
    seen.append(sighting(4.0, 2.0, 0, size=0.015))
    check = compare_with_truth(merge(seen, CAMERA, radius=0.008), truth, 0.004)
    counts = [(c.defects, c.found, c.false_alarms) for c in check.classes]
    assert counts == [(1, 1, 0), (1, 0, 0), (2, 1, 0), (0, 0, 1), (1, 1, 0)]
    assert check.recall() == pytest.approx(2 / 3) and check.recall(0.0) == pytest.approx(0.6)
    assert [d.size_m for d in check.missed_from(0.005)] == [0.006]
    np.testing.assert_allclose(check.offsets, np.tile([0.0, 0.001], (3, 1)), atol=1e-12)
    empty = compare_with_truth([], [], 0.004)
    assert empty.recall() == 1.0 and empty.errors.shape == (0,)


def test_the_mask_leaves_out_edges_and_what_is_beyond():
    inner = RASTER.panel == 0
    middle = int(np.flatnonzero(inner & (np.abs(RASTER.uv - [2.0, 1.6]).max(axis=1) < 0.3))[0])
    assert panel_mask(CAMERA, VIEWS, middle, PANELS) is None
    corner = int(np.flatnonzero(inner & (RASTER.uv < 0.5).all(axis=1))[0])
    mask = panel_mask(CAMERA, VIEWS, corner, PANELS, margin=0.01)
    assert mask is not None and mask.shape == (CAMERA.height, CAMERA.width)
    rng = np.random.default_rng(0)
    for low, high, expected in [(0.012, 0.3, True), (0.0, 0.008, False)]:
        uv = np.column_stack([rng.uniform(low, high, 400), rng.uniform(0.02, 0.4, 400)])
        pixels = world_pixels(CAMERA, VIEWS, corner, panel_points(PANELS[1], uv))
        column, row = np.rint(pixels[CAMERA.in_picture(pixels, 1.0)]).astype(int).T
        assert len(row) > 100 and np.all(mask[row, column] == expected)


def test_bad_radii_are_refused():
    with pytest.raises(InputError, match="radius to merge sightings in = 0 m"):
        merge([], CAMERA, radius=0.0)
    with pytest.raises(InputError, match="tolerance of places = 0 m"):
        compare_with_truth([], [], 0.0)


def survey(shoot: Shoot, seed: int) -> list[Finding]:
    """A survey with pictures: noise on them, and poses that are not quite known."""
    true, tile, sightings = disturbed(VIEWS, seed), noise_tile(CAMERA, 1.5, seed), []
    for k in range(len(RASTER)):
        picture = with_noise(shoot(CAMERA, true, k), tile, seed + k)
        found = find_defects(picture, None, panel_mask(CAMERA, VIEWS, k, SURVEYED))
        sightings += locate(found, CAMERA, VIEWS, k, SURVEYED)
    return merge(sightings, CAMERA, radius=2.0 * ERROR)


@pytest.mark.slow
@pytest.mark.render
def test_two_rendered_surveys_find_every_defect_and_what_a_mission_changed(tmp_path: Path):
    before = seeded_defects(21, SURVEYED, 60)
    after = next_mission(before, 22, SURVEYED, new=8, grown=8, cleaned=4)
    maps = []
    for seed, defects in ((100, before), (200, after)):
        shoot = painted(tmp_path / str(seed), SURVEYED, defects)
        findings = survey(shoot, seed)
        check = compare_with_truth(findings, defects, ERROR)
        assert check.missed_from(0.005) == [] and check.recall(0.0) > 0.95
        assert len(check.false_alarms) == 0
        assert check.errors.max() < ERROR
        assert np.abs(check.size_errors).max() < 0.003 and check.size_errors.std() < 0.001
        maps.append((findings, check))
    (first, _), (second, check) = maps
    compared = compare_surveys(first, second, radius=2.0 * ERROR)
    known = {f.name: d for f, d in check.pairs}
    assert len(compared.new) == 8 and len(compared.gone) == 4
    assert {known[f.name] for f in compared.new} == set(after[-8:])
    really = {d for d in after[:-8] if d not in before}
    assert {known[late.name] for _, late in compared.grown} == really and len(really) == 8
