"""Follow-the-leader by another algorithm: no spheres, no module lengths, nothing iterated by them.

FTL-95 fits the arm to the path from tip to base by spheres whose radii depend on the joints, and
repeats. Here it is laid from base to tip, once. Frame j-1 and spine point j are known; joint j
turns about Z_j, which frame j-1 holds, and carries the odd hinge j+1 a distance Delta along X_j;
that hinge lies square to X_j and Z_j, and spine point j+2 is S away from it. So whatever the two
angles are, spine point j+2 lies on

    (rho - Delta)^2 + z^2 = S^2,    z along Z_j, rho its distance from that axis:

a torus about Z_j with radii Delta and S. As Delta < S it cuts itself; the arm uses the outer sheet
(rho >= 0: the odd angle is less than 90 deg and a bit), and the body inside it is seen whole from
its centre, spine point j. The path, coming from there, leaves it at spine point j+2. Which exit?
FTL-95 takes the last arc length before j+2 at which j can lie, and this march the first after j at
which j+2 can: with one exit both are the same. A path whose tangent turns by well less than a right
angle along a module has one, because the distance from either end then only grows. `march` counts
what it finds, so that a test can insist.

All of it hangs on one number, the arc length of spine point 4, and the tip's arc length grows with
it: one scalar root puts the tip where it shall be.

On a line the torus is a quartic in the length t; on a circular arc it is one too, in
t = 2 r tan(phi / 2): all crossings are found, none by sampling. Newton on the torus itself, not on
its square, then gives full precision. The base needs no formula either: Newton from home finds its
three joints, on the branch that home is on.

Own mathematics in numpy on purpose: nothing here comes from `pips_drake`, and of a path and an arm
only numbers are taken.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

#: Rounding of arc lengths up to 10 m, summed over pieces: a hit this far outside a piece is on it.
SLACK = 1e-12
#: How far (m) a quartic's rounded root may be from a crossing: small offsets give nearly double
#: roots, which rounding moves aside by its square root. Newton decides.
NEAR = 1e-2


@dataclass(frozen=True)
class Piece:
    """A line (radius 0: origin is its start, u its direction) or an arc (origin is its centre,
    u points from there to its start, v along its tangent there); from arc length `start` on, m."""

    start: float
    length: float
    radius: float
    origin: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def point(self, t: float) -> np.ndarray:
        """Point (3,) m, t m after the piece's start."""
        if self.radius == 0.0:
            return self.origin + t * self.u
        # From the arc's start, by half angles: its centre may be a kilometre away.
        half = 0.5 * t / self.radius
        chord = 2.0 * self.radius * math.sin(half)
        start = self.origin + self.radius * self.u
        return start + chord * (math.cos(half) * self.v - math.sin(half) * self.u)

    def tangent(self, t: float) -> np.ndarray:
        """Unit tangent (3,)."""
        if self.radius == 0.0:
            return self.u
        phi = t / self.radius
        return math.cos(phi) * self.v - math.sin(phi) * self.u

    def distance(self, p: np.ndarray) -> float:
        """Distance (m) of a point (3,) m."""
        w = p - self.point(0.0)
        if self.radius == 0.0:
            nearest = [min(max(float(w @ self.u), 0.0), self.length)]
        else:
            turn = math.atan2(float(w @ self.v), self.radius + float(w @ self.u)) % (2.0 * math.pi)
            nearest = [0.0, self.length, min(turn * self.radius, self.length)]
        return min(float(np.linalg.norm(p - self.point(t))) for t in nearest)


class Path:
    """A chain of pieces, extended along its last tangent so that a march never falls off."""

    def __init__(self, pieces: list[Piece]) -> None:
        last = pieces[-1]
        self.own_pieces = pieces
        self.length = last.start + last.length
        end, direction = last.point(last.length), last.tangent(last.length)
        beyond = Piece(self.length, 1e3, 0.0, end, direction, np.zeros(3))
        self.pieces = [*pieces, beyond]
        self._starts = np.array([piece.start for piece in self.pieces])

    @classmethod
    def through(cls, vertices: np.ndarray) -> Path:
        """The polyline through vertices (P, 3) m."""
        pieces, start = [], 0.0
        for a, b in itertools.pairwise(vertices):
            length = float(np.linalg.norm(b - a))
            pieces.append(Piece(start, length, 0.0, a, (b - a) / length, np.zeros(3)))
            start += length
        return cls(pieces)

    @classmethod
    def of_table(cls, table: np.ndarray) -> Path:
        """From rows (start, length, radius, origin 3, u 3, v 3) as `TipPath.pieces` documents."""
        return cls([Piece(*map(float, r[:3]), r[3:6], r[6:9], r[9:12]) for r in table])

    def index(self, s: float) -> int:
        """The piece that holds arc length s (m), the later one at a joint."""
        return max(0, int(np.searchsorted(self._starts, s, side="right")) - 1)

    def point(self, s: float) -> np.ndarray:
        """Point (3,) m at arc length s (m)."""
        piece = self.pieces[self.index(s)]
        return piece.point(s - piece.start)

    def distance(self, p: np.ndarray) -> float:
        """Distance (m) of a point (3,) m from the path itself, without its extension."""
        return min(piece.distance(p) for piece in self.own_pieces)


@dataclass(frozen=True)
class Chain:
    """An arm in numbers.

    Attributes:
        rows: Craig's table (joints, 5): alpha (rad), a (m), d (m), theta (rad), 1 for a slide, to
            which the joint's value is added in d, else in theta.
        home: joint values (joints,) at which the base's Newton starts, m and rad.
    """

    rows: np.ndarray
    home: np.ndarray

    @property
    def modules(self) -> int:
        """A module has two joints; the base has three and the tip one."""
        return (len(self.rows) - 4) // 2

    def offset_and_length(self, module: int) -> tuple[float, float]:
        """Delta and S of a module, from 0, m."""
        return float(self.rows[4 + 2 * module, 1]), float(self.rows[5 + 2 * module, 1])

    def frames(self, q: np.ndarray) -> list[np.ndarray]:
        """Homogeneous matrices (4, 4) of the first len(q) joints' frames (FTL-95 Eq 2.1)."""
        result, pose = [], np.eye(4)
        for (alpha, a, d, theta, slides), value in zip(self.rows, q, strict=False):
            pose = pose @ _turned_x(alpha) @ _moved([a, 0.0, d + slides * value])
            pose = pose @ _turned_z(theta + (1.0 - slides) * value)
            result.append(pose)
        return result

    def spine_points(self, q: np.ndarray) -> np.ndarray:
        """Origins (M + 1, 3) m of frames 4, 6, ..."""
        return np.array([pose[:3, 3] for pose in self.frames(q)[3::2]])


def _turned_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def _turned_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def _moved(by: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = by
    return pose


@dataclass(frozen=True)
class March:
    """What a march from a given arc length of spine point 4 found.

    Attributes:
        joints: (joints,) m and rad, the last 0.
        arc_lengths: of the spine points, (M + 1,) m.
        exits: how often the path crosses each module's torus while that could still be spine
            point j+2: along twice the module's reach from spine point j on, (M,).
    """

    joints: np.ndarray
    arc_lengths: np.ndarray
    exits: np.ndarray


def base_joints(chain: Chain, target: np.ndarray) -> np.ndarray:
    """The base's three joints (3,) that put spine point 4 on `target` (3,) m, by Newton."""
    q = chain.home[:3].copy()
    q[0] += target[2] - chain.frames(chain.home[:4])[3][2, 3]  # the slide runs along z
    # Spine point 4 does not move with joint 4.
    for _ in range(30):
        frames = chain.frames(np.append(q, 0.0))
        here = frames[3][:3, 3]
        columns = [
            pose[:3, 2] if row[4] else np.cross(pose[:3, 2], here - pose[:3, 3])
            for pose, row in zip(frames[:3], chain.rows, strict=False)
        ]
        step = np.linalg.solve(np.array(columns).T, target - here)
        # At most a tenth of a radian at once: no leap to the other branch.
        step *= min(1.0, 0.1 / max(0.1, np.abs(step[1:]).max()))
        q += step
        if np.abs(step).max() < 1e-15:
            break
    return q


def march(chain: Chain, path: Path, s4: float) -> March:
    """Lays the arm on the path from spine point 4 at arc length `s4` (m) to the tip."""
    q = list(base_joints(chain, path.point(s4)))
    pose = chain.frames(np.array(q))[-1]
    arcs, exits = [s4], []
    for module in range(chain.modules):
        offset, length = chain.offset_and_length(module)
        even_row, odd_row = 3 + 2 * module, 4 + 2 * module
        # Frame j for theta_j = 0: its Z is the torus' axis, its origin spine point j.
        pose = pose @ _turned_x(chain.rows[even_row, 0]) @ _moved([chain.rows[even_row, 1], 0, 0])
        centre, axis = path.point(arcs[-1]), pose[:3, 2]
        crossings = torus_crossings(path, arcs[-1], centre, axis, offset, length)
        arcs.append(crossings[0])
        exits.append(len(crossings))
        w = pose[:3, :3].T @ (path.point(arcs[-1]) - centre)
        q.append(math.atan2(w[1], w[0]))
        pose = pose @ _turned_z(q[-1]) @ _turned_x(chain.rows[odd_row, 0]) @ _moved([offset, 0, 0])
        # Frame j+1 for theta_{j+1} = 0: its hinge is Z, so spine point j+2 lies in its X-Y plane.
        w = pose[:3, :3].T @ (path.point(arcs[-1]) - pose[:3, 3])
        q.append(math.atan2(w[1], w[0]))
        pose = pose @ _turned_z(q[-1])
    return March(np.array([*q, 0.0]), np.array(arcs), np.array(exits))


def torus_crossings(
    path: Path, s: float, centre: np.ndarray, axis: np.ndarray, offset: float, length: float
) -> list[float]:
    """Arc lengths (m) after `s` at which the path crosses the outer sheet, in order; the first is
    an exit. Looked for as far as twice the module's reach, and until there is one."""
    found: list[float] = []
    index, end = path.index(s), s + 2.0 * (offset + length)
    while index < len(path.pieces):
        piece = path.pieces[index]
        if piece.start > end and found:
            break
        low = max(0.0, s - piece.start)
        for t in piece_crossings(piece, low, centre, axis, offset, length):
            # A crossing at the joint between two pieces is found on both.
            if not found or piece.start + t > found[-1] + 10.0 * SLACK:
                found.append(piece.start + t)
        index += 1
    return [found[0], *(hit for hit in found[1:] if hit < end)]


def piece_crossings(
    piece: Piece,
    low: float,
    centre: np.ndarray,
    axis: np.ndarray,
    offset: float,
    length: float,
) -> list[float]:
    """Crossings of a piece with the outer sheet from `low` m after its start on, m, in order."""

    def sheet(t: float) -> tuple[float, float]:
        """(rho - Delta)^2 + z^2 - S^2 and its derivative."""
        w, dw = piece.point(t) - centre, piece.tangent(t)
        z, dz = float(w @ axis), float(dw @ axis)
        rho = math.sqrt(max(float(w @ w) - z * z, 0.0))
        drho = (float(w @ dw) - z * dz) / rho if rho > 0.0 else 0.0
        value = (rho - offset) ** 2 + z * z - length * length
        return value, 2.0 * ((rho - offset) * drho + z * dz)

    result = []
    for t in _candidates(piece, centre, axis, offset, length):
        if piece.radius:  # into the turn that begins at `low`, or just before it
            turn = 2.0 * math.pi * piece.radius
            t = (t - low + NEAR) % turn + low - NEAR
        if not low - NEAR <= t <= piece.length + NEAR:
            continue
        for _ in range(60):
            value, slope = sheet(t)
            step = -value / slope if slope != 0.0 else 0.0
            t += step
            if abs(step) < 1e-15:
                break
        # 1e-12 m^2: what Newton leaves where it found no root is far from rounding.
        on_sheet = abs(sheet(t)[0]) < 1e-12
        if on_sheet and low - SLACK <= t <= piece.length + SLACK:
            result.append(min(max(t, low), piece.length))
    result.sort()
    return [t for i, t in enumerate(result) if i == 0 or t > result[i - 1] + 10.0 * SLACK]


def _candidates(
    piece: Piece, centre: np.ndarray, axis: np.ndarray, offset: float, length: float
) -> list[float]:
    """Near the real roots of A^2 = 4 Delta^2 rho^2, A = |w|^2 + Delta^2 - S^2: both sheets squared.

    With bend = 1 / r, t = 2 r tan(phi / 2) and D = 1 + (bend t / 2)^2, the vector from the torus'
    centre is w = d + (t v - bend t^2 / 2 u) / D, d to the arc's start. So |w|^2 D and z D are of
    second degree in t, and the equation times D^2 is of fourth. On a line bend is 0 and D is 1.
    """
    if piece.radius:
        bend, along, inward = 1.0 / piece.radius, piece.v, -piece.u
    else:
        bend, along, inward = 0.0, piece.u, np.zeros(3)
    d = piece.point(0.0) - centre
    spread = np.array([0.25 * bend * bend, 0.0, 1.0])  # D
    square = float(d @ d) * spread  # |w|^2 D
    square += [1.0 + bend * float(d @ inward), 2.0 * float(d @ along), 0.0]
    height = float(d @ axis) * spread  # z D
    height += [0.5 * bend * float(inward @ axis), float(along @ axis), 0.0]
    # A D. Without offset both sheets are one sphere, and its square would have double roots.
    polynomial = square + (offset * offset - length * length) * spread
    if offset > 0.0:
        rho_square = np.convolve(square, spread) - np.convolve(height, height)  # rho^2 D^2
        polynomial = np.convolve(polynomial, polynomial) - 4.0 * offset**2 * rho_square
    roots = [x.real for x in np.roots(polynomial) if abs(x.imag) < NEAR]
    return [2.0 / bend * math.atan(0.5 * bend * t) if bend else t for t in roots]


def solve(chain: Chain, path: Path, s_tip: float) -> March:
    """The posture with the tip at arc length `s_tip` (m): one scalar root for spine point 4's."""
    pairs = [chain.offset_and_length(module) for module in range(chain.modules)]

    def miss(s4: float) -> float:
        return float(march(chain, path, s4).arc_lengths[-1]) - s_tip

    # A module's arc is at least as long as its chord, and that at least S - Delta; a micrometre
    # more, because a straight arm without offsets is exactly that long.
    high = s_tip - sum(length - offset for offset, length in pairs) + 1e-6
    low = s_tip - sum(length + offset for offset, length in pairs)
    reach = s_tip - low
    while low > 0.0 and miss(low) > 0.0:
        low -= 0.1 * reach
    s4 = brentq(miss, max(low, 0.0), high, xtol=1e-15, rtol=4.0 * np.finfo(float).eps)
    return march(chain, path, float(s4))
