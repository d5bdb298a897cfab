"""One frame's collisions and separating planes.

`exact`: whole convex bodies, effector or effector and payload against everything else, at any
distance. `report`: RMS-71's own tests, with what they miss: in mode 1 the effector's hexahedra
against the bar (none beyond 8 ft), their vertices against the payload's top and the ends of the
palm against the bar's top; in mode 2 the payload's vertices against the bay, in mode 3 against the
front half of the CAE.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.bodies import EFFECTOR, PAYLOAD, MachineBodies, Placement
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.convex_bodies import vertices_inside
from pips_drake.remote_manipulator.docking import cae_front_planes
from pips_drake.remote_manipulator.hexahedra import face_planes, report_collision, separating_planes
from pips_drake.remote_manipulator.phases import TABLE, Phase
from pips_drake.units import FOOT

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: The face that separates each of the effector's hexahedra from a bar that is held: d of the palm,
#: b of the finger, e of the prong (RMS-71, CALSP1 to CALSP3), as axis of {2} and its direction.
_HELD_FACES = ((0, 1.0), (1, 1.0), (1, -1.0))

#: Rows of the palm's vertices, as a box in {2}, that are its bottom's (face d, +x2): those at -z2
#: and +z2 on one side of the bar, then on the other.
_BOTTOM = [2, 3, 6, 7]


@dataclass(frozen=True, eq=False)
class Contact:
    """What a frame's collision test finds.

    Attributes:
        effector: which of palm, finger and prong collide, (3,).
        payload: the payload that is held collides.
        separation: the least of all pairs, m; negative by the depth where bodies meet. Of bodies
            that are apart it is no more than their distance.
        pair: row of the least separation in the list of pairs (free or held).
        normals: of all pairs, from second to first, unit vectors in {R}, (N, 3).
        separations: of all pairs, (N,) m.
        planes: D1 to D3, between palm, finger, prong and the bar, (3, 4); NaN where there is none.
    """

    effector: tuple[bool, bool, bool]
    payload: bool
    separation: float
    pair: int
    normals: Array
    separations: Array
    planes: Array

    @property
    def any(self) -> bool:
        """Something collides."""
        return self.payload or any(self.effector)


class CollisionTest:
    """The collision test of one machine.

    Args:
        config: the machine.
        report: RMS-71's own tests decide.
    """

    def __init__(self, config: RemoteManipulatorConfig, *, report: bool = False) -> None:
        self.machine = MachineBodies(config)
        self._report = ReportTest(config, self.machine) if report else None
        pairs, names = self.machine.held_pairs, self.machine.names
        # The payload and the CAE that it is docked to.
        carried = [names.index(name) for name in PAYLOAD]
        self._docked = np.isin(pairs[:, 0], carried) & (pairs[:, 1] == names.index("core"))
        effector = config.effector
        self._bottom = config.arm.arm_2_m + effector.palm.length_m
        self._finger = -effector.finger_offset_m

    def pair_names(self, pair: int, *, held: bool) -> tuple[str, str] | None:
        """The two bodies of a row of the list of pairs; None for -1."""
        if pair < 0:
            return None
        first, second = (self.machine.held_pairs if held else self.machine.free_pairs)[pair]
        return self.machine.names[first], self.machine.names[second]

    def __call__(self, phase: Phase, placement: Placement) -> Contact:
        """What collides in a phase with everything at `placement`."""
        facts = TABLE[phase]
        pairs = self.machine.held_pairs if facts.grasped else self.machine.free_pairs
        R, p = self.machine.poses(placement)
        found = self.machine.bodies.separations(pairs, R, p)
        collides = found.separation <= 0.0
        gaps = found.separation
        if facts.grasped and facts.support == "port":
            # Nothing moves, and the payload is at the port on purpose.
            collides[:] = False
            gaps = np.where(self._docked, np.inf, gaps)
        row = int(gaps.argmin())
        if facts.grasped:
            planes = self._held_planes(placement)
            hits, payload = [False] * 3, bool(collides.any())
        else:
            planes = found.plane[: len(EFFECTOR)]
            hits = np.bincount(pairs[collides, 0], minlength=len(EFFECTOR)).astype(bool).tolist()
            payload = False
        if self._report is not None and facts.mode != 4:
            if facts.grasped:
                payload = self._report.payload_collides(facts.mode, R, p)
            else:
                hits, planes = self._report.effector_collides(R, p)
        return Contact(
            (hits[0], hits[1], hits[2]),
            payload,
            float(gaps[row]),
            row,
            found.normal,
            found.separation,
            planes,
        )

    def _held_planes(self, placement: Placement) -> Array:
        R, p = placement.X_R2
        inner = (self._bottom, self._finger, self._finger + placement.gap)
        planes = np.empty((3, 4))
        for row, ((axis, way), at) in enumerate(zip(_HELD_FACES, inner, strict=True)):
            # The effector's hexahedron on the TRUE side, as everywhere: against the face's normal.
            normal = -way * R[:, axis]
            planes[row] = *normal, normal @ (p + at * R[:, axis])
        return planes


class ReportTest:
    """What RMS-71's program tests, and no more."""

    def __init__(self, config: RemoteManipulatorConfig, machine: MachineBodies) -> None:
        self._machine = machine
        self._far = config.acquisition.far_ft * FOOT
        payload, bay = config.payload, config.cargo_bay
        self._top = -0.5 * payload.across_flats_m
        self._half = np.array([0.5 * payload.length_m, 0.5 * payload.across_flats_m])
        bar = machine.bodies.bodies[machine.names.index("bar")].vertices
        self._bar_low, self._bar_high = bar.min(axis=0), bar.max(axis=0)
        self._front = cae_front_planes(config)
        low = np.array(bay.location_m) - [0.0, 0.5 * bay.width_m, 0.0]
        self._bay_low = low
        self._bay_high = low + np.array([bay.length_m, bay.width_m, bay.depth_m])

    def effector_collides(self, R: Array, p: Array) -> tuple[list[bool], Array]:
        """Which of palm, finger and prong collide, and the planes D1 to D3, (3, 4)."""
        machine, rows = self._machine, range(len(EFFECTOR))
        hexahedra = np.array([machine.vertices(name, R, p) for name in EFFECTOR])
        k = machine.names.index("bar")
        bar = machine.vertices("bar", R, p)
        in_payload = [(hexahedra[row] - p[k]) @ R[k] for row in rows]
        hits = [self._below_top(points) for points in in_payload]
        bottom = hexahedra[0][_BOTTOM].mean(axis=0)
        if np.linalg.norm(bottom - bar.mean(axis=0)) > self._far:
            # One face of the bar for all three: its top, c.
            top = face_planes(bar[None])[0, 2]
            return hits, np.tile(top, (3, 1))
        bars = np.tile(bar, (3, 1, 1))
        met = report_collision(hexahedra, bars).collides
        hits = [hit or bool(one) for hit, one in zip(hits, met, strict=True)]
        hits[0] = hits[0] or self._edge_touches(in_payload[0])
        return hits, separating_planes(hexahedra, bars)

    def _below_top(self, points: Array) -> bool:
        """A vertex in {P} is below the payload's top, inside its outline and above its middle."""
        over = (np.abs(points[:, :2]) < self._half).all(axis=1)
        return bool((over & (points[:, 2] > self._top) & (points[:, 2] < 0.0)).any())

    def _edge_touches(self, palm: Array) -> bool:
        """AQFTST: the middle of an end of the palm's bottom is below the bar's top, in {P}."""
        middles = 0.5 * (palm[_BOTTOM[:2]] + palm[_BOTTOM[2:]])
        inside = (middles > self._bar_low) & (middles < self._bar_high)
        return bool(inside.all(axis=1).any())

    def payload_collides(self, mode: int, R: Array, p: Array) -> bool:
        """Whether a vertex of hull or probe is in a wall (mode 2) or in the CAE (mode 3)."""
        machine = self._machine
        points = np.concatenate([machine.vertices(name, R, p) for name in ("hull", "probe")])
        if mode == 2:
            # Below face c of the bay, and beyond another.
            below = points[:, 2] > self._bay_low[2]
            beyond = (points[:, :2] < self._bay_low[:2]) | (points > self._bay_high)[:, :2]
            return bool((below & (beyond.any(axis=1) | (points[:, 2] > self._bay_high[2]))).any())
        k = machine.names.index("core")
        inside = vertices_inside((points - p[k]) @ R[k], self._front)
        return bool(inside.any())
