"""Separating planes, decision trees and permanent priority lists (RMS-71, section V.C).

The report's own trees (Figure 19), model and planes (Figure 20) are lost. These are ours, for our
model, in the report's form: a node of a tree is a separating plane, and what is on the eye's side
of it comes first; a leaf is a list of clusters; a permanent list is what is left of the trees for
an eye whose side of the fixed planes is known. Names that the report keeps in its text are kept:
planes 11, 12 and D1 to D3; trees W1, X1, Y1, Y2, Z1 and Z2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator import geometry
from pips_drake.remote_manipulator.clusters import MachinePose, orbiter_solids
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.phases import Phase

Array = NDArray[np.float64]

#: RMS-71, Table VII: permanent priority lists of its own model, highest priority first. Numbers are
#: its clusters (21 is the CAE), letters its trees. The scan has "AE" for A and E, "17" for 7 in B's
#: list (D's has the same five), "Wy" for W1, and "7, 4" for Z, Y in G's. Data: nothing computes
#: with it, as the clusters' own list is lost.
REPORT_LISTS: Mapping[str, tuple[str, ...]] = {
    "A": ("12", "1", "Z2", "4", "3", "2", "6", "7", "10", "8", "21"),
    "B": ("3", "Z2", "2", "4", "6", "7", "W1", "21"),
    "C": ("10", "8", "Z2", "12", "4", "3", "2", "6", "7", "1", "21"),
    "D": ("6", "Z2", "7", "4", "3", "2", "W1", "21"),
    "E": ("12", "1", "Z2", "4", "3", "2", "6", "7", "10", "8", "21"),
    "F": ("Z", "Y", "21"),
    "G": ("Z", "Y", "21"),
    "H": ("21", "Z", "Y"),
    "I": ("12", "1", "21", "Z2", "4", "3", "2", "6", "7", "10", "8"),
}
#: RMS-71, Table VIII: the frame that the report tests a plane in, where the scan can be read.
REPORT_PLANE_FRAMES: Mapping[str, str] = {
    "1": "R",
    "7": "R",
    "8": "P",
    "9": "P",
    "11": "1",
    "12": "2",
    "15": "2",
    "16": "R",
    "D3": "R",
}


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A fixed plane, across an axis of its frame: its true side is where that coordinate is larger.

    Attributes:
        frame: R, C, P, Q ({P} rolled by 45 deg), or 2 for the effector's.
        axis: 0, 1 or 2: x, y or z.
        at: the coordinate, m.
        meaning: which face it is.
    """

    frame: str
    axis: int
    at: float
    meaning: str


def fixed_planes(config: RemoteManipulatorConfig) -> dict[str, Plane]:
    """The planes that are fixed in a frame, by number.

    1 to 7 and 16 to 25 stand in {R} (2 in {C}), 8, 9 and 26 to 29 in {P}, 30 to 33 in {Q},
    which is {P} rolled by 45 deg; 13 and 14 in {2}.
    """
    bay, cae, payload = config.cargo_bay, config.central_assembly_element, config.payload
    cabin, arm, palm = geometry.cabin_part(config), config.arm, config.effector.palm
    x, y, z = bay.location_m
    side, wall, half = 0.5 * bay.width_m, bay.wall_m, 0.5 * payload.across_flats_m
    end = 0.5 * payload.length_m
    deck = next(part for part in orbiter_solids(config) if part.name == "deck_forward")
    port, starboard = (deck.position[1] + k * deck.size[1] for k in (0.5, -0.5))
    table: dict[str, tuple[str, int, float, str]] = {
        "1": ("R", 2, z, "the deck and the bay's face c"),
        "2": ("C", 0, 0.5 * cae.across_flats_m, "the CAE's face c"),
        "3": ("R", 2, z - config.orbiter.cabin_height_m, "the cabin's roof"),
        "4": ("R", 0, cabin.position[0] + 0.5 * cabin.size[0], "the cabin's aft face"),
        "5": ("R", 0, x, "the forward wall's inner face"),
        "6": ("R", 0, x + bay.length_m, "the aft wall's inner face"),
        "7": ("R", 1, y + side, "the port wall's inner face"),
        "8": ("P", 2, -half, "the payload's top"),
        "9": ("P", 0, -end, "the payload's forward end"),
        "13": ("2", 0, arm.arm_2_m + palm.length_m, "the palm's bottom, face d"),
        "14": ("2", 0, arm.arm_2_m, "the palm's top"),
        "16": ("R", 1, y - side, "the starboard wall's inner face"),
        "17": ("R", 2, z + bay.depth_m, "the bay's floor"),
        "18": ("R", 1, cabin.position[1] + 0.5 * cabin.size[1], "the cabin's port side"),
        "19": ("C", 2, 0.5 * cae.height_m, "the CAE's underside"),
        "20": ("R", 0, x - wall, "the forward wall's outer face"),
        "21": ("R", 0, x + bay.length_m + wall, "the aft wall's outer face"),
        "22": ("R", 1, y + side + wall, "the port wall's outer face"),
        "23": ("R", 1, y - side - wall, "the starboard wall's outer face"),
        "24": ("R", 1, port, "the deck's port edge"),
        "25": ("R", 1, starboard, "the deck's starboard edge"),
        "26": ("P", 0, end, "the payload's aft end"),
        "27": ("P", 1, half, "the payload's port side"),
        "28": ("P", 1, -half, "the payload's starboard side"),
        "29": ("P", 2, half, "the payload's underside"),
        "30": ("Q", 1, half, "the payload's lower port slant"),
        "31": ("Q", 1, -half, "the payload's upper starboard slant"),
        "32": ("Q", 2, half, "the payload's lower starboard slant"),
        "33": ("Q", 2, -half, "the payload's upper port slant"),
    }
    return {
        name: Plane(frame=frame, axis=axis, at=at, meaning=meaning)
        for name, (frame, axis, at, meaning) in table.items()
    }


#: Planes that move with the arm: 10, 11 and 12 bisect the angles between stand and arm 0, arms 0
#: and 1, arms 1 and 2 (Figure 14; 10 is ours); 15 is midway between finger and prong.
MOVING_PLANES = ("10", "11", "12", "15")
#: Between palm (D1), finger (D2), prong (D3) and the bar: from the collision program.
BAR_PLANES = ("D1", "D2", "D3")
#: The hexahedra that they part from the bar: EFF HEX 1 to 3.
SORTED_AGAINST = ("palm", "finger", "prong")


def plane_table(planes: Mapping[str, Plane]) -> Array:
    """Fixed planes in their own frames, (k, 4): unit normal and distance, n . x = d."""
    table = np.zeros((len(planes), 4))
    for row, plane in zip(table, planes.values(), strict=True):
        row[plane.axis], row[3] = 1.0, plane.at
    return table


def bisecting_planes(pose: MachinePose) -> Array:
    """Planes 10, 11 and 12 in {R}, (3, 4): unit normal, towards the palm, and distance.

    Figure 14: the normal is the sum of the unit vectors along the two neighbours, "A + B", so that
    the plane bisects the angle between them.
    """
    arm = pose.arm
    ways = np.array([[0.0, 0.0, -1.0], arm.R_R0[:, 0], arm.R_R1[:, 0], arm.R_R2[:, 0]])
    normals = ways[:-1] + ways[1:]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(lengths, 1e-12)
    points = np.array([arm.shoulder, arm.elbow, arm.wrist])
    return np.column_stack([normals, np.sum(normals * points, axis=1)])


@dataclass(frozen=True)
class Node:
    """A node of a decision tree: a plane by its number, and what is on its two sides."""

    plane: str
    true: Tree
    false: Tree


@dataclass(frozen=True)
class Chain:
    """Trees whose order is fixed, highest priority first."""

    entries: tuple[Tree, ...]


@dataclass(frozen=True)
class EffectorList:
    """The "special priority": the bar is sorted into a tree's list by the planes D1 to D3."""

    tree: Tree


#: A leaf is a list of clusters, highest priority first.
Tree: TypeAlias = Node | Chain | EffectorList | tuple[str, ...]

#: End effector: arm 2, palm, fingers; and the bar.
X1 = EffectorList(
    Node("14", Node("13", Node("15", ("prong",), ("finger",)), ("palm",)), ("arm_2",))
)
#: Arm without payload.
Z1 = Node("10", Node("11", Node("12", X1, ("arm_1",)), ("arm_0",)), ("stand",))
_PAYLOAD = Node("9", ("hull",), ("probe",))
#: Arm with payload: Z1 is a proper subtree of it.
Z2 = Node("8", _PAYLOAD, Z1)


def _orbiter(inside: Tree) -> Tree:
    """The deck, the bay and what is in it."""
    forward = Node("5", inside, ("wall_forward",))
    ends = Node("6", ("wall_aft",), forward)
    walls = Node("7", ("wall_port",), Node("16", ends, ("wall_starboard",)))
    bay = Node("17", ("floor",), walls)
    sills = Node("22", ("deck_port",), Node("23", bay, ("deck_starboard",)))
    return Node("21", ("deck_aft",), Node("20", sills, ("deck_forward",)))


#: Shuttle with payload in its bay, and without.
Y1 = _orbiter(_PAYLOAD)
Y2 = _orbiter(())


def front(arm: Tree) -> Tree:
    """W1, what is ahead: the CAE and the cabin; and the arm between and abaft of them."""
    return Node("2", Node("3", ("cabin",), arm), ("core",))


#: The whole scene with the payload in its bay, and with the payload anywhere else.
IN_BAY = Node("1", Y1, front(Z1))
OUT_OF_BAY = Node("1", Y2, front(Z2))


def scene_tree(phase: str) -> Tree:
    """The tree that is traced in a phase (the report's "mode test")."""
    payload_in_bay = phase in (Phase.STOWED.name.lower(), Phase.EXTRACTION.name.lower())
    return IN_BAY if payload_in_bay else OUT_OF_BAY


def tree_planes(tree: Tree) -> tuple[str, ...]:
    """The planes of a tree's nodes, each once."""
    if isinstance(tree, EffectorList):
        return tree_planes(tree.tree)
    if isinstance(tree, Node):
        names = (tree.plane, *tree_planes(tree.true), *tree_planes(tree.false))
        return tuple(dict.fromkeys(names))
    return ()


def deciding_planes(tree: Tree) -> dict[tuple[str, str], str]:
    """The plane that decides each pair of a tree's clusters: that of the node that parts them.

    Keys: the cluster on the plane's true side, then the one on its false side. Of the bar with the
    effector: D1 to D3, in either order.
    """
    return _deciding(tree)[1]


def _deciding(tree: Tree) -> tuple[tuple[str, ...], dict[tuple[str, str], str]]:
    if isinstance(tree, EffectorList):
        names, pairs = _deciding(tree.tree)
        for name, plane in zip(SORTED_AGAINST, BAR_PLANES, strict=True):
            pairs[("bar", name)] = pairs[(name, "bar")] = plane
        pairs[("bar", "arm_2")] = "14"
        return (*names, "bar"), pairs
    if isinstance(tree, Node):
        true, pairs = _deciding(tree.true)
        false, others = _deciding(tree.false)
        pairs |= others
        pairs |= {(one, two): tree.plane for one in true for two in false}
        return (*true, *false), pairs
    assert isinstance(tree, tuple)
    return tree, {}


def permanent_list(tree: Tree, sides: Mapping[str, bool]) -> tuple[Tree, ...]:
    """What is left of a tree for an eye whose sides of some planes are known, in order.

    Entries are lists of clusters ("direct cluster references") or trees with planes that are still
    to be tested ("tree root node references").
    """
    if isinstance(tree, Node) and tree.plane in sides:
        near, far = (tree.true, tree.false) if sides[tree.plane] else (tree.false, tree.true)
        entries: list[Tree] = []
        for entry in (*permanent_list(near, sides), *permanent_list(far, sides)):
            if isinstance(entry, tuple) and entries and isinstance(entries[-1], tuple):
                entries[-1] = (*entries[-1], *entry)
            else:
                entries.append(entry)
        return tuple(entries)
    if isinstance(tree, Node):
        return (Node(tree.plane, _rest(tree.true, sides), _rest(tree.false, sides)),)
    return (tree,) if tree else ()


def _rest(tree: Tree, sides: Mapping[str, bool]) -> Tree:
    entries = permanent_list(tree, sides)
    return entries[0] if len(entries) == 1 else Chain(entries)
