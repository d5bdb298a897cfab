"""Random scenes for the painter's priority, and the depth of each cluster along rays of sight.

The depth is that of convex hulls (scipy's, of the clusters' vertices) cut by lines: it knows no
separating planes.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator import geometry
from pips_drake.remote_manipulator.clusters import MachinePose, machine_pose
from pips_drake.remote_manipulator.configuration import StationConfig, load_configuration
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.priority import Priority, PriorityModel

CONFIG = load_configuration()
MODEL = PriorityModel(CONFIG)
NAMES = MODEL.clusters.names
#: The payload in {2} while it is held: x2 = z_P, z2 = x_P, the palm's bottom on the bar's top.
R_2P = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
_REACH = CONFIG.arm.arm_2_m + CONFIG.effector.palm.length_m
_BAR = CONFIG.receptacle.height_m + 0.5 * CONFIG.payload.across_flats_m
P_2P = np.array([_REACH + _BAR, 0.0, 0.0])
DOCKED = np.array(CONFIG.central_assembly_element.location_m) + (
    geometry.docking_port(CONFIG) - geometry.probe_tip(CONFIG)
)
STOWED = np.array(CONFIG.payload.location_m)


def random_pose(phase: str, rng: np.random.Generator) -> MachinePose:
    """Of a phase: the arm anywhere, or at the bar, or where it holds the payload."""
    return machine_pose(CONFIG, *random_state(phase, rng))


def random_state(phase: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Arm vector (8,) and payload pose (7,) of a `random_pose`."""
    arm = CONFIG.arm
    height = rng.uniform(CONFIG.stand.lower_m, CONFIG.stand.upper_m)
    gap = rng.uniform(CONFIG.effector.prong_closed_gap_m, CONFIG.effector.prong_open_gap_m)
    R_RP, p_RP = np.eye(3), STOWED
    angles = rng.uniform(arm.lower, arm.upper)
    if phase == "stowed" and rng.random() < 0.6:
        tilt = Rotation.from_rotvec(rng.normal(0.0, 0.15, 3)).as_matrix()
        above = [rng.uniform(-1.0, 1.0), rng.uniform(-0.3, 0.3), -abs(rng.normal(0.0, 0.5))]
        angles = _holding(tilt, STOWED + above, height)
    elif phase == "extraction":
        R_RP = Rotation.from_rotvec(rng.normal(0.0, 0.01, 3)).as_matrix()
        p_RP = STOWED + rng.uniform([-0.4, -0.05, -5.0], [0.4, 0.05, 0.0])
        angles, gap = _holding(R_RP, p_RP, height), CONFIG.effector.prong_closed_gap_m
    elif phase == "docked_held":
        # A little before the port.
        p_RP, height = DOCKED + rng.uniform(0.0, [0.2, 0.0, 0.0]), CONFIG.stand.upper_m
        angles, gap = _holding(R_RP, p_RP, height), CONFIG.effector.prong_closed_gap_m
    elif phase == "manoeuvring":
        gap = CONFIG.effector.prong_closed_gap_m
        if rng.random() < 0.7:
            low, high = (-70, 20, -120, -40, -90, -60), (40, 100, -40, 40, 0, 60)
            angles = np.radians(rng.uniform(low, high))
        hand = forward_kinematics(arm, angles, height)
        R_RP, p_RP = hand.R_R2 @ R_2P, hand.wrist + hand.R_R2 @ P_2P
    elif phase == "docked":
        p_RP = DOCKED
    elif phase == "free_flying":
        R_RP = Rotation.random(random_state=rng).as_matrix()
        p_RP = rng.uniform([-3.0, -12.0, -15.0], [20.0, 8.0, -3.0])
    if angles is None:  # out of the arm's reach
        return random_state(phase, rng)
    return np.array([height, *angles, gap]), seven(R_RP, p_RP)


def _holding(R_RP: np.ndarray, p_RP: np.ndarray, height: float) -> np.ndarray | None:
    R_R2 = R_RP @ R_2P.T
    palm = p_RP - R_R2 @ P_2P + R_R2[:, 0] * CONFIG.arm.arm_2_m
    return nearest_angles(CONFIG.arm, palm, R_R2, height, CONFIG.arm.home)


def seven(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """A pose as (7,)."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z, *position])


def eye_and_look(station: StationConfig, pose: MachinePose) -> tuple[np.ndarray, np.ndarray]:
    """A station's eye (3,) m and axes (3, 3) in {R}; x looks ahead."""
    arm = pose.arm
    rotation, position = {
        "R": (np.eye(3), np.zeros(3)),
        "0": (arm.R_R0, arm.shoulder),
        "1": (arm.R_R1, arm.elbow),
        "P": (pose.R_RP, pose.p_RP),
        "C": (pose.R_RC, pose.p_RC),
    }[station.frame]
    look = Rotation.from_euler("ZY", [station.heading_deg, station.pitch_deg], degrees=True)
    eye = rotation @ np.array(station.position_m) + position
    return eye, rotation @ look.as_matrix()


def rays(look: np.ndarray, pixels: int) -> np.ndarray:
    """Directions of a picture of 60 deg height and 4 : 3, (pixels**2, 3)."""
    half = math.tan(math.radians(30.0))
    # Not symmetric: no ray runs along a face that the eye is level with.
    at = np.linspace(-half, half, pixels) + 1e-5
    y, z = np.meshgrid(at * 4.0 / 3.0, at, indexing="ij")
    ahead = np.column_stack([np.ones(pixels**2), y.ravel(), z.ravel()])
    result: np.ndarray = ahead @ look.T
    return result


def depths(pose: MachinePose, eyes: list[np.ndarray], sights: list[np.ndarray]) -> list[np.ndarray]:
    """For each eye, where rays enter and leave each cluster, (2, n, rays); NaN where they miss."""
    vertices = MODEL.clusters.vertices(pose)
    ends = [*MODEL.clusters.starts, len(vertices)]
    hulls = [ConvexHull(vertices[a:b]).equations for a, b in itertools.pairwise(ends)]
    return [_depth(hulls, eye, sight) for eye, sight in zip(eyes, sights, strict=True)]


def _depth(hulls: list[np.ndarray], eye: np.ndarray, sight: np.ndarray) -> np.ndarray:
    entered, left = [], []
    for faces in hulls:
        height, slope = faces[:, :3] @ eye + faces[:, 3], sight @ faces[:, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -height / slope
        enter = np.max(np.where(slope < 0.0, at, -np.inf), axis=1)
        leave = np.min(np.where(slope > 0.0, at, np.inf), axis=1)
        outside = np.any((slope == 0.0) & (height > 0.0), axis=1)
        enter = np.maximum(enter, 0.0)
        # A ray that only grazes an edge hits nothing.
        hit = (leave > enter + 1e-7) & ~outside
        entered.append(np.where(hit, enter, np.nan))
        left.append(np.where(hit, leave, np.nan))
    return np.array([entered, left])


@dataclass
class Count:
    """Of pairs of clusters that are both seen on some ray."""

    overlapping: int = 0
    # Solids that stand in one another on a ray: no order of them is right, none must be claimed.
    meeting: int = 0
    claimed: int = 0
    # Some ray has the later cluster nearer: of those that are claimed, and of the others.
    wrong: int = 0
    wrong_unclaimed: int = 0

    @property
    def share(self) -> float:
        """How many of the pairs that have an order are claimed."""
        return self.claimed / (self.overlapping - self.meeting)

    def add(self, priority: Priority, depth: np.ndarray) -> None:
        """Counts the pairs of one picture; `depth` as `depths` gives it."""
        enter, leave = depth[:, [NAMES.index(name) for name in priority.order]]
        for i, j in itertools.combinations(range(len(enter)), 2):
            both = np.isfinite(enter[i]) & np.isfinite(enter[j])
            if not np.any(both):
                continue
            # Clusters may touch: 1 um is no more than rounding of where rays meet faces.
            wrong = bool(np.any(enter[i, both] > enter[j, both] + 1e-6))
            shared = np.minimum(leave[i], leave[j]) - np.maximum(enter[i], enter[j])
            claimed = bool(priority.claims[i, j])
            self.overlapping += 1
            self.meeting += bool(np.any(shared[both] > 1e-6)) and not claimed
            self.claimed += claimed
            self.wrong += claimed and (wrong or bool(np.any(shared[both] > 1e-6)))
            self.wrong_unclaimed += wrong and not claimed
