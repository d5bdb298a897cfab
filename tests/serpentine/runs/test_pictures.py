"""Pictures of a run: all there, and the tightest moment looked at from where it can be seen."""

import matplotlib.image
import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.runs import pictures
from pips_drake.serpentine.runs.assessment import Assessment, RunData
from pips_drake.serpentine.station import load_setup

PINK = np.array([0xE6, 0x00, 0x7E]) / 255.0


@pytest.fixture(name="made", scope="module")
def _made(tmp_path_factory):
    """Pictures of a planned motion, as if it had been simulated."""
    folder = tmp_path_factory.mktemp("pictures")
    loaded = load_scenario("trajectory_4")
    setup = load_setup(loaded.config, folder=loaded.folder)
    s = setup.path.samples(0.25)
    joints = setup.solver.solve(setup.path, s).joints
    n = s.size
    # A witness at the end of the path: 200 mm ahead of the camera's front, in the world of the pad
    # mounting (x0 down from 3 m, z0 forward); inches of Table C.4.
    end = np.array([202.902, -29.0, 0.0]) * 0.0254 + [0.0, 0.0, 3.0 - 73.255 * 0.0254]
    witness = np.tile([end - [0, 0.1524, 0], end - [0, 0.3524, 0]], (n, 1, 1))
    data = RunData(
        time=np.arange(n, dtype=float),
        tip_arc_lengths=s,
        commanded_joints=joints,
        joints=joints,
        joint_rates=np.zeros_like(joints),
        joint_efforts=np.zeros_like(joints),
        clearance=np.linspace(0.5, 0.2, n),
        self_clearance=np.full(n, 0.4),
        pairs=tuple(("prototype::camera_head", "payload::payload") for _ in range(n)),
        solution=np.zeros((n, 2)),
        witness=witness,
    )
    assessment = Assessment(
        arm=setup.arm,
        motion=setup.motion,
        checks=loaded.config.checks,
        data=data,
        clearance_range=0.5,
    )
    assert pictures.write_run_pictures(folder, loaded.config, setup, assessment) is None
    return folder


@pytest.mark.render
def test_every_picture_is_there_and_not_blank(made):
    for name in ("scene", "stages", "end", "least_clearance"):
        picture = matplotlib.image.imread(made / f"{name}.png")[:, :, :3]
        assert min(picture.shape[:2]) >= 900, name
        # A blank picture has no spread; the payload alone gives 0.1.
        assert picture.std() > 0.05, name


@pytest.mark.render
def test_the_witness_line_is_drawn_near_the_middle(made):
    picture = matplotlib.image.imread(made / "least_clearance.png")[:, :, :3]
    rows, columns = np.nonzero(np.all(np.abs(picture - PINK) < 0.05, axis=-1))
    assert rows.size > 50
    # The camera looks at the middle of the witness points; title and label take some space.
    height, width = picture.shape[:2]
    assert abs(np.median(columns) - 0.5 * width) < 0.12 * width
    assert abs(np.median(rows) - 0.5 * height) < 0.15 * height
