"""Arms, paths and independent kinematics that several test files use."""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np
import pytest

from pips_drake.config import load_yaml, validate
from pips_drake.scene.packages import find_arm_file
from pips_drake.serpentine.arm import SerpentineArm, load_arm, make_arm
from pips_drake.serpentine.arm_file import ArmFile, JointConfig, SegmentConfig
from pips_drake.serpentine.follow_the_leader import FollowTheLeader


@pytest.fixture(scope="session")
def arm() -> SerpentineArm:
    return load_arm("prototype")


@pytest.fixture(scope="session")
def ftl(arm: SerpentineArm) -> FollowTheLeader:
    return FollowTheLeader(arm)


@pytest.fixture(scope="session")
def arm_variant() -> Callable[..., SerpentineArm]:
    """Makes arms that differ from the prototype: other segments, offsets, base or hand."""
    prototype = load_yaml(ArmFile, find_arm_file("prototype"))

    def make(
        *,
        lengths: list[float] | None = None,
        offsets: list[float] | None = None,
        base: str = "rail_crane",
        mirrored: bool = False,
        limit_deg: float = 30.0,
    ) -> SerpentineArm:
        config = copy.deepcopy(prototype)
        config.mirrored = mirrored
        config.motion_base.kind = base
        if lengths is not None:
            config.segments = [SegmentConfig(length_in=s, box="small") for s in lengths]
        for segment, offset in zip(config.segments, offsets or [], strict=False):
            segment.offset_in = offset
        home = {"rail_crane": -90.0, "gimbal": 0.0}[base]
        config.joints = [
            JointConfig(name="d1", unit="in", home=24.9, lower=24.9, upper=114.5),
            JointConfig(name="theta2", home=home, lower=home - limit_deg, upper=home + limit_deg),
        ]
        for j in range(3, 2 * len(config.segments) + 3):
            config.joints.append(JointConfig(name=f"theta{j}", lower=-limit_deg, upper=limit_deg))
        validate(config)
        return make_arm(config)

    return make


@pytest.fixture(scope="session")
def random_postures() -> Callable[[SerpentineArm, int], np.ndarray]:
    """Postures (N, joints) inside the limits, the last joint 0: the same in every run."""

    def make(arm: SerpentineArm, count: int) -> np.ndarray:
        rng = np.random.default_rng(1995)
        q = rng.uniform(arm.joint_lower, arm.joint_upper, size=(count, arm.joints))
        q[:, -1] = 0.0
        return q

    return make


@pytest.fixture(scope="session")
def report_frames() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Frames by products of FTL-95 Eq 2.1's matrix, from rows (alpha, a, d, theta)."""

    def transform(alpha: float, a: float, d: float, theta: float) -> np.ndarray:
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        return np.array(
            [
                [c, -s, 0.0, a],
                [s * ca, c * ca, -sa, -d * sa],
                [s * sa, c * sa, ca, d * ca],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    def make(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Rows as Table A.1 prints them, with NaN where the joint's variable stands."""
        result = [np.eye(4)]
        for row, value in zip(rows, q, strict=True):
            result.append(result[-1] @ transform(*np.where(np.isnan(row), value, row)))
        return np.stack(result[1:])

    return make


@pytest.fixture(scope="session")
def table_a1() -> np.ndarray:
    """FTL-95 Table A.1 as printed, in rad and m; NaN stands for the joint's variable."""
    free = np.nan
    deltas = [1.250, 1.250, 1.500, 1.188, 1.188, 1.500, 0.813]
    lengths = [20.035, 20.035, 20.035, 16.100, 16.100, 16.100, 12.000, 12.000]
    rows = [[0.0, 11.250, free, 0.0], [-90.0, 0.0, -5.005, free], [-45.0, 8.908, 7.078, free]]
    for length, delta in zip(lengths, deltas, strict=False):
        rows += [[-90.0, length, 0.0, free], [90.0, delta, 0.0, free]]
    rows.append([-90.0, lengths[-1], 0.0, free])
    return np.array(rows) * [np.pi / 180.0, 0.0254, 0.0254, 1.0]
