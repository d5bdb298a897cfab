"""How much of a scanned surface the camera at the tip saw.

The surface is cut into small equal patches, and each is looked at from every place of the camera:
it is seen if it lies in the picture, within the camera's range and incidence, and nothing stands in
between. That is found exactly by sphere tracing: a ball around a point of the ray whose radius is
the distance there holds no obstacle. The target's own shape cannot hide a part of itself that faces
the camera, as a cylinder is convex; the arm itself is not looked at: its camera is in front.

The camera looks at the point of the surface that is nearest to it, as far as pan and tilt let it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.planning.scan_target import ON_SURFACE, CylinderTarget, ScanCamera, others
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.pointing import make_mount, pan_tilt_towards, target_before_last

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

#: Default edge of a patch, m.
PATCH_SIZE = 0.025
#: More patches than this are a mistake in a number.
MOST_PATCHES = 4_000_000
#: A ray is blocked where it comes so near to an obstacle, m; obstacles are met as much too early.
_TOUCHED = 1e-4
#: Balls along a ray; what has not ended by then grazes something.
_MOST_BALLS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPoses:
    """Where a camera was, and how it was turned.

    Attributes:
        positions: (K, 3) m in the world.
        rotations: (K, 3, 3); columns are to the right, down, and into the picture.
        off: angle between its view and the nearest point of the surface, (K,) rad: what pan and
            tilt could not turn.
    """

    positions: Array
    rotations: Array
    off: Array


@dataclass(frozen=True, kw_only=True)
class Hole:
    """A part of a surface in one piece that was not seen.

    Attributes:
        area: m^2.
        along, around: its extents on the surface, m.
        middle: along (m) and around (rad) of the mean of its patches.
    """

    area: float
    along: float
    around: float
    middle: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanCoverage:
    """Which patches of a target were seen; arrays are (A, B), along and around.

    Attributes:
        target: the surface.
        passes: by how many passes each patch was seen.
        covered: which patches something lies on: they are not counted as surface.
        hidden: for patches that were looked at, but always from behind an obstacle, the index of
            one in `obstacles`; -1 for others.
        obstacles: names of what hides patches.
    """

    target: CylinderTarget
    passes: Cells
    covered: NDArray[np.bool_]
    hidden: Cells
    obstacles: tuple[str, ...] = ()

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which patches were seen."""
        return (self.passes > 0) & ~self.covered

    @property
    def patch_area(self) -> float:
        """Of each, m^2."""
        return self.target.area / self.passes.size

    @property
    def area(self) -> float:
        """Of the surface that is not covered, m^2."""
        return self.patch_area * int((~self.covered).sum())

    @property
    def seen_area(self) -> float:
        """m^2."""
        return self.patch_area * int(self.seen.sum())

    @property
    def share(self) -> float:
        """Seen share of the surface."""
        return self.seen_area / self.area if self.area > 0.0 else 0.0

    @property
    def hidden_areas(self) -> dict[str, float]:
        """What was not seen because of each obstacle, m^2."""
        return {
            name: self.patch_area * int((self.hidden == k).sum())
            for k, name in enumerate(self.obstacles)
        }

    @cached_property
    def holes(self) -> tuple[Hole, ...]:
        """What was not seen, piece by piece, the largest first."""
        unseen = ~self.seen & ~self.covered
        labels, _ = ndimage.label(unseen)
        if self.target.whole_turn:  # the first and the last column touch
            for row in np.flatnonzero(unseen[:, 0] & unseen[:, -1]):
                labels[labels == labels[row, -1]] = labels[row, 0]
        along, around = patch_middles(self.target, self.passes.shape)
        high = np.array(
            [np.ptp(self.target.along), self.target.radius * np.ptp(self.target.around)]
        )
        edges = high / self.passes.shape
        found = []
        for label in np.unique(labels[labels > 0]):
            rows, columns = np.nonzero(labels == label)
            # Across the seam a mean angle is that of a mean direction.
            mean = np.exp(1j * around[columns]).mean()
            found.append(
                Hole(
                    area=self.patch_area * rows.size,
                    along=float(edges[0] * np.unique(rows).size),
                    around=float(edges[1] * np.unique(columns).size),
                    middle=(float(along[rows].mean()), float(np.angle(mean))),
                )
            )
        return tuple(sorted(found, key=lambda hole: -hole.area))

    def sentences(self) -> tuple[str, ...]:
        """What a report says of it."""
        said = [f"seen {self.seen_area:.2f} m^2 of {self.area:.2f} m^2, {100 * self.share:.1f} %"]
        if self.holes:
            hole = self.holes[0]
            said.append(
                f"largest hole {hole.area:.3f} m^2, {hole.along:.2f} m along and "
                f"{hole.around:.2f} m around, at {hole.middle[0]:.2f} m and "
                f"{math.degrees(hole.middle[1]):.0f} deg"
            )
        for name, area in self.hidden_areas.items():
            if area > 0.0:
                said.append(f"{area:.3f} m^2 always behind {name}")
        return tuple(said)


def patch_middles(target: CylinderTarget, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Where the patches' middles are: along, (A,) m, and around, (B,) rad."""
    ways = []
    for (low, high), count in zip((target.along, target.around), shape, strict=True):
        ways.append(low + (high - low) * (np.arange(count) + 0.5) / count)
    return ways[0], ways[1]


def cover(
    target: CylinderTarget,
    camera: ScanCamera,
    poses: CameraPoses,
    *,
    passes: ArrayLike | None = None,
    field: SignedDistanceField | None = None,
    size: float = PATCH_SIZE,
) -> ScanCoverage:
    """What a camera saw from where it was.

    Args:
        passes: to which pass each pose belongs, (K,), never falling; all to one by default.
        field: what may stand in between; the shape that the target is the surface of is left out.
        size: largest edge of a patch, m.

    Raises:
        InputError: a number that means nothing, or too many patches.
    """
    require(math.isfinite(size) and size > 0.0, "patch size", f"{size} m", "> 0")
    edges = np.ptp(target.along), target.radius * np.ptp(target.around)
    shape = (math.ceil(edges[0] / size - 1e-9), math.ceil(edges[1] / size - 1e-9))
    require(math.prod(shape) <= MOST_PATCHES, "patches", math.prod(shape), f"<= {MOST_PATCHES}")
    numbers = np.zeros(len(poses.positions), np.int64) if passes is None else np.asarray(passes)
    if numbers.shape != (len(poses.positions),) or (np.diff(numbers) < 0).any():
        raise InputError("passes of a scan; must be one for each pose, and never fall")
    along, around = patch_middles(target, shape)
    points = target.to_world(*np.meshgrid(along, around, indexing="ij"))
    normals = target.normals(around)
    scene = None if field is None else others(target, field)
    if scene is not None and not scene.shapes:
        scene = None
    covered = np.zeros(shape, dtype=bool)
    if scene is not None:
        covered = (scene.distances(points.reshape(-1, 3)) < ON_SURFACE).reshape(shape)
    count, last = np.zeros(shape, np.int64), np.full(shape, -1, np.int64)
    blocker = np.full(shape, -1, np.int64)
    for row, (position, rotation) in enumerate(zip(poses.positions, poses.rotations, strict=True)):
        rows, columns = _within_sight(target, camera, position, along, around)
        block = np.ix_(rows, columns)
        seen, distance = _in_picture(camera, position, rotation, points[block], normals[columns])
        if not seen.any():
            continue
        i, j = np.nonzero(seen)
        places = rows[i], columns[j]
        if scene is not None:
            behind = blockers(scene, position, points[places], distance[i, j])
            blocker[places] = np.where(behind >= 0, behind, blocker[places])
            free = behind < 0
            places = places[0][free], places[1][free]
        new = last[places] != numbers[row]
        count[places] += new
        last[places] = numbers[row]
    names: tuple[str, ...] = ()
    hidden = np.full(shape, -1, np.int64)
    if scene is not None:
        behind = (count == 0) & ~covered & (blocker >= 0)
        which = np.unique(blocker[behind])
        names = tuple(scene.label(int(k)) for k in which)
        hidden[behind] = np.searchsorted(which, blocker[behind])
    return ScanCoverage(
        target=target, passes=count, covered=covered, hidden=hidden, obstacles=names
    )


def blockers(field: SignedDistanceField, start: Array, ends: Array, lengths: Array) -> Cells:
    """Which shape stands between a point (3,) m and others (N, 3) m, (N,): -1 if none does.

    Args:
        lengths: of the ways, (N,) m. Their last millimetre is left out: it touches the target.
    """
    found = np.full(len(ends), -1, dtype=np.int64)
    ways = (ends - start) / lengths[:, None]
    first = float(field.distances(start[None])[0])
    if first < _TOUCHED:
        return np.asarray(np.full(len(ends), int(field.nearest(start[None]).indices[0])))
    walked = np.full(len(ends), first)
    left = np.flatnonzero(walked < lengths - ON_SURFACE)
    for _ in range(_MOST_BALLS):
        if not left.size:
            return found
        near = field.nearest(start + walked[left, None] * ways[left])
        hit = near.distances < _TOUCHED
        found[left[hit]] = near.indices[hit]
        walked[left] += near.distances
        left = left[~hit & (walked[left] < lengths[left] - ON_SURFACE)]
    found[left] = field.nearest(start + walked[left, None] * ways[left]).indices
    return found


def camera_poses(
    arm: SerpentineArm,
    joints: ArrayLike,
    target: CylinderTarget,
    camera: ScanCamera,
    *,
    shift: ArrayLike = (0.0, 0.0, 0.0),
) -> CameraPoses:
    """Where an arm's camera is, looking at the target's nearest point as well as it can.

    Args:
        joints: (K, J) m and rad; the last one is taken as it is, pan and tilt do the rest.
        shift: of the arm's frame in the world, (3,) m.
    """
    postures = np.atleast_2d(np.asarray(joints, dtype=np.float64))
    mount = make_mount(arm, pan_limit=camera.pan_limit, tilt_limit=camera.tilt_limit)
    away = np.asarray(shift, dtype=np.float64)
    last = kinematics.frames(arm, postures)[:, -1]
    positions = last[:, :3, 3] + away + mount.reach * last[:, :3, 0]
    along, around, height = target.from_world(positions)
    nearest = target.to_world(
        np.clip(along, *target.along), np.clip(around, *target.around), np.zeros_like(height)
    )
    rotations = np.empty((len(postures), 3, 3))
    for k, (q, point) in enumerate(zip(postures, nearest, strict=True)):
        local = target_before_last(arm, q, point - away)
        pan, tilt = pan_tilt_towards(arm, mount, local, float(q[-1]))
        rotations[k] = last[k, :3, :3] @ view_rotation(pan, tilt, camera.roll)
    wanted = nearest - positions
    wanted /= np.linalg.norm(wanted, axis=1)[:, None]
    ahead = rotations[:, :, 2]
    across = np.linalg.norm(np.cross(ahead, wanted), axis=1)
    off = np.arctan2(across, np.einsum("ij,ij->i", ahead, wanted))
    return CameraPoses(positions=positions, rotations=rotations, off=off)


def view_rotation(pan: float, tilt: float, roll: float) -> Array:
    """To the right, down and into the picture, in the mount, columns of (3, 3).

    The mount looks along its x; pan is about its z, tilt towards it, and roll about the view turns
    what was up to the left (`twin.camera.camera_rotation`, which mathematics may not know).
    """
    ahead = np.array(
        [math.cos(tilt) * math.cos(pan), math.cos(tilt) * math.sin(pan), math.sin(tilt)]
    )
    right = np.array([math.sin(pan), -math.cos(pan), 0.0])
    down = np.cross(ahead, right)
    c, s = math.cos(roll), math.sin(roll)
    return np.column_stack([c * right + s * down, c * down - s * right, ahead])


def _within_sight(
    target: CylinderTarget, camera: ScanCamera, position: Array, along: Array, around: Array
) -> tuple[Cells, Cells]:
    """Rows and columns beyond which a patch is too far away, or seen too much from the side.

    At incidence i a point is no farther than h / cos(i) from a camera at height h, as the way out
    along its normal is at most h: so no farther aside than h tan(i).
    """
    z, angle, height = (float(x[0]) for x in target.from_world(position[None]))
    if height <= 0.0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    aside = min(height * math.tan(camera.incidence), camera.far)
    rows = np.flatnonzero(np.abs(along - z) <= aside)
    turn = math.asin(min(1.0, aside / target.radius)) if aside < target.radius else math.pi
    away = np.mod(around - angle + math.pi, 2.0 * math.pi) - math.pi
    return rows, np.flatnonzero(np.abs(away) <= turn)


def _in_picture(
    camera: ScanCamera, position: Array, rotation: Array, points: Array, normals: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Which points (A, B, 3) m with normals (B, 3) a camera would see in the open; distances m."""
    view = points - position
    distance = np.linalg.norm(view, axis=-1)
    x, y, z = np.moveaxis(view @ rotation, -1, 0)
    facing = -np.einsum("abi,bi->ab", view, normals)
    across, down = camera.slopes
    seen = facing >= distance * math.cos(camera.incidence)
    seen &= (distance >= camera.near) & (distance <= camera.far)
    seen &= (np.abs(x) <= across * z) & (np.abs(y) <= down * z)
    return seen, distance
