"""An arm's bodies as capsules: how near a posture comes to obstacles, said within a millisecond.

Each box that collides lies in a capsule about its long axis whose radius is that of the box's
edges about that axis; each ball is a capsule without length. Distances of points on the axes are
exact (`scene.signed_distance`), and a signed distance changes by no more than one goes, so that
between two points of an axis at distances a and b, a way w apart, it is (a + b - w) / 2 at least.
Pieces of axes are halved until that is enough, or until they are too short to matter: what comes
out is a bound, not a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.links import collision_shapes

Array = NDArray[np.float64]

#: Axes are looked at in pieces of about this length first, m.
COARSEST = 0.12
#: And in none shorter than this, m: by half of it a bound may be below the distance.
FINEST = 2e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmEnvelope:
    """Capsules around what of an arm can collide with a scene; the rail, which stands, is left out.

    Attributes:
        names: of the bodies that they belong to, (B,).
        frames: the joint frame that each is fixed in, (B,), from 0.
        starts, ends: of the axes in that frame, (B, 3) m.
        radii: (B,) m.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    starts: Array
    ends: Array
    radii: Array

    def axes(self, arm: SerpentineArm, joints: ArrayLike, shift: Array) -> tuple[Array, Array]:
        """Both ends (B, 3) m of the axes in a posture (J,).

        Args:
            shift: from frame {0} to the frame that is wanted, (3,) m.
        """
        poses = kinematics.frames(arm, joints)[0, self.frames]
        turns, origins = poses[:, :3, :3], poses[:, :3, 3] + shift
        first: Array = np.einsum("bij,bj->bi", turns, self.starts) + origins
        last: Array = np.einsum("bij,bj->bi", turns, self.ends) + origins
        return first, last


def make_envelope(arm: SerpentineArm) -> ArmEnvelope:
    """The capsules around an arm's bodies, as the plant has them."""
    names, frames, starts, ends, radii = [], [], [], [], []
    for j, body in enumerate(arm.bodies):
        for shape in collision_shapes(arm, body):
            half, rounded = np.zeros(3), 0.0
            if shape.kind == "box":
                half = 0.5 * shape.size
            elif shape.kind == "sphere":
                rounded = float(shape.size[0])
            else:  # a cylinder is no larger than the box around it
                half = np.array([shape.size[0], shape.size[0], 0.5 * shape.size[1]])
            k = int(np.argmax(half))
            along = np.zeros(3)
            along[k] = half[k]
            if shape.rotation is not None:
                along = shape.rotation.apply(along)
            names.append(body.name)
            frames.append(j)
            starts.append(shape.centre - along)
            ends.append(shape.centre + along)
            radii.append(rounded + float(np.hypot(*np.delete(half, k))))
    return ArmEnvelope(
        names=tuple(names),
        frames=np.array(frames),
        starts=np.array(starts),
        ends=np.array(ends),
        radii=np.array(radii),
    )


def clearance_bound(
    field: SignedDistanceField, starts: Array, ends: Array, radii: Array, *, enough: float
) -> float:
    """A lower bound of the least distance from capsules to a field's shapes, m.

    Args:
        starts, ends: of the capsules' axes in the field's frame, (B, 3) m.
        radii: (B,) m.
        enough: m; a bound of at least this is not made better, and once a point is seen to be
            nearer, its distance is returned instead.
    """
    lengths = np.linalg.norm(ends - starts, axis=1)
    counts = np.maximum(np.ceil(lengths / COARSEST).astype(np.int64), 1)
    owner = np.repeat(np.arange(len(radii)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    # Pieces of axes: shares of the axis at both ends, and what is known there.
    low, high = place / counts[owner], (place + 1) / counts[owner]

    def look(share: Array, body: NDArray[np.int64]) -> Array:
        points = starts[body] + share[:, None] * (ends[body] - starts[body])
        return field.distances(points) - radii[body]

    # A piece begins where the one before it ends, but for an axis' first.
    first = np.append(0, np.cumsum(counts)[:-1])
    far = look(
        np.concatenate([high, np.zeros(len(radii))]), np.append(owner, np.arange(len(radii)))
    )
    b = far[: len(owner)]
    a = np.empty_like(b)
    a[1:] = b[:-1]
    a[first] = far[len(owner) :]
    seen, bound = float(far.min()), np.inf
    while True:
        ways = (high - low) * lengths[owner]
        bounds = 0.5 * (a + b - ways)
        open_ = (bounds < enough) & (ways > FINEST)
        bound = min(bound, float(np.min(bounds[~open_], initial=np.inf)))
        if seen < enough:
            return min(seen, bound)
        if not open_.any():
            return bound
        owner, low, high, a, b = owner[open_], low[open_], high[open_], a[open_], b[open_]
        middle = 0.5 * (low + high)
        between = look(middle, owner)
        seen = min(seen, float(between.min()))
        owner = np.concatenate([owner, owner])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        a, b = np.concatenate([a, between]), np.concatenate([between, b])
