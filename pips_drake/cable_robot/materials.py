"""What the cables should be made of: ropes of one strength and stiffness, and what they do wrong.

CABLE-96, section 4: the stiffness in the stiffest and softest directions "can help in the choice of
cable material". Stiffness alone does not choose: a rope of any material can be made thick enough.
What is left is what a thick rope costs: its weight lets it sag, and heat and creep change its
length. So every candidate is given the section that both strength and axial stiffness ask for, and
what it then adds to the errors of the lengths is compared.

Sections are those of fibres or wires, without the air between. A rope's modulus and strength are
shares of its fibres' or wires': these shares are assumed; they differ by construction, and ropes
that are heat-set under tension are better than given here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.kinematics import Poses, cable_lengths
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import characteristic_length
from pips_drake.cable_robot.stiffness import elastic_stiffness, stiffness_directions
from pips_drake.config import require

Array = NDArray[np.float64]

#: Breaking strength over the largest allowed tension; assumed, as for lifting with textile slings
#: (7) and steel ropes (5).
SAFETY = 5.0
#: Share of a rope's round section that is fibre or wire; assumed.
_FILLED = 0.75
#: Change of temperature in the hall between calibration and survey, assumed, K.
TEMPERATURE_CHANGE = 5.0
#: How well the axial stiffness is known, assumed: the stretch is corrected for but for this share.
STIFFNESS_ERROR = 0.1
_GRAVITY = 9.81
_FIBRES = "Teijin, table of tensile properties of industrial fibres (Technora data)"


@dataclass(frozen=True, kw_only=True)
class Material:
    """Fibres or wires, and ropes of them.

    Attributes:
        name: of the material.
        modulus, strength: of fibres or wires, Pa.
        density: kg/m3.
        expansion: by heat along the fibre, 1/K.
        modulus_share, strength_share: of a rope, over those of its fibres or wires; assumed.
        creep: strain of a day at a fifth of the strength, assumed; less load, less creep.
        bends: whether it bears being wound on a winch again and again.
        remark: on creep and use.
        source: of the numbers.
    """

    name: str
    modulus: float
    strength: float
    density: float
    expansion: float
    modulus_share: float
    strength_share: float
    creep: float
    bends: bool
    remark: str
    source: str

    def __post_init__(self) -> None:
        for name in ("modulus", "strength", "density", "modulus_share", "strength_share"):
            value = getattr(self, name)
            good = math.isfinite(value) and value > 0.0
            require(good, f"{self.name}: {name}", f"{value:g}", "> 0")


MATERIALS: tuple[Material, ...] = (
    Material(
        name="steel wire rope",
        modulus=200e9,
        strength=1.77e9,
        density=7850.0,
        expansion=12e-6,
        modulus_share=0.5,
        strength_share=0.85,
        creep=0.0,
        bends=True,
        remark="no creep once bedded in; sheaves must be wide",
        source="grade 1770 wire, ropes of many strands; modulus and expansion of steel: textbooks",
    ),
    Material(
        name="tungsten wire rope",
        modulus=400e9,
        strength=2.5e9,
        density=19250.0,
        expansion=4.5e-6,
        modulus_share=0.5,
        strength_share=0.85,
        creep=0.0,
        bends=True,
        remark="for ropes below a millimetre, as in surgical robots; thick ones are not sold",
        source="modulus, density and expansion of the metal: textbooks; strength assumed",
    ),
    Material(
        name="aramid",
        modulus=105e9,
        strength=2.98e9,
        density=1450.0,
        expansion=-4.9e-6,
        modulus_share=0.6,
        strength_share=0.55,
        creep=1e-4,
        bends=False,
        remark="fatigues where it is bent and pressed along its fibres; light and damp harm it",
        source=f"{_FIBRES}, high modulus; expansion as of Kevlar 49, creep: assumed",
    ),
    Material(
        name="HMPE",
        modulus=116e9,
        strength=3.6e9,
        density=975.0,
        expansion=-12e-6,
        modulus_share=0.6,
        strength_share=0.55,
        creep=3e-4,
        bends=True,
        remark="creeps most, the more the warmer: stretch it before calibration; smooth, floats",
        source="DSM, fact sheet CIS YA100 (2010), SK78: strength 3.3 .. 3.9, modulus 109 .. 132 "
        "GPa; expansion, creep: assumed",
    ),
    Material(
        name="Vectran",
        modulus=74.5e9,
        strength=3.23e9,
        density=1410.0,
        expansion=-4.8e-6,
        modulus_share=0.6,
        strength_share=0.55,
        creep=2e-5,
        bends=True,
        remark="next to no creep; light harms it, so that it needs a cover",
        source=f"{_FIBRES}, polyarylate HT; expansion, creep: assumed",
    ),
)


@dataclass(frozen=True, kw_only=True)
class RopeNeed:
    """What a robot asks of its ropes.

    Attributes:
        strength: breaking strength, N.
        axial_stiffness: E A, N; 0 for none.
        longest: cable, m.
        tension: of a cable at work, for stretch and creep, N.
        slackest: tension at which the sag is taken, N.
        temperature_change: K.
    """

    strength: float
    axial_stiffness: float
    longest: float
    tension: float
    slackest: float
    temperature_change: float = TEMPERATURE_CHANGE

    def __post_init__(self) -> None:
        for name in ("strength", "longest", "tension", "slackest"):
            value = getattr(self, name)
            good = math.isfinite(value) and value > 0.0
            require(good, f"rope: {name}", f"{value:g}", "> 0")
        for name in ("axial_stiffness", "temperature_change"):
            value = getattr(self, name)
            good = math.isfinite(value) and value >= 0.0
            require(good, f"rope: {name}", f"{value:g}", ">= 0")


@dataclass(frozen=True, kw_only=True)
class MaterialRow:
    """A rope of one material, and what it adds to the error of the longest cable's length.

    Attributes:
        material: which.
        section: of fibres or wires, m2; diameter: of the rope, m.
        mass_per_length: kg/m.
        axial_stiffness: E A of the rope, N; strength: N.
        sag: of the longest cable, level and at the slackest tension: w l^2 / 8 T, m.
        sag_error: by which the sagging rope is longer than the straight line: w^2 l^3 / 24 T^2, m.
        stretch: of the longest cable at the working tension, m.
        stretch_error: the share of it that is not known, m.
        thermal_error: |expansion| change of temperature l, m.
        creep_error: of a day, m.
        softest: softest direction of the robot's elastic stiffness with this rope, N/m; nan if no
            robot was given.
    """

    material: Material
    section: float
    diameter: float
    mass_per_length: float
    axial_stiffness: float
    strength: float
    sag: float
    sag_error: float
    stretch: float
    stretch_error: float
    thermal_error: float
    creep_error: float
    softest: float

    @property
    def length_error(self) -> float:
        """All errors of the length, added up as the worst case, m."""
        return self.sag_error + self.stretch_error + self.thermal_error + self.creep_error


def rope_need(
    robot: CableRobot, poses: Poses, tensions: ArrayLike, *, safety: float = SAFETY
) -> RopeNeed:
    """What a robot at work asks for: `safety` times its largest allowed tension, and its E A.

    Args:
        tensions: at the poses, (N, M) N. The working tension is the largest; the sag is taken at
            the tension that half of all cables exceed.
    """
    require(math.isfinite(safety) and safety >= 1.0, "safety", f"{safety:g}", ">= 1")
    T = np.asarray(tensions, dtype=np.float64)
    largest = robot.tension_max if math.isfinite(robot.tension_max) else float(T.max())
    return RopeNeed(
        strength=safety * largest,
        axial_stiffness=float(robot.axial_stiffness.max()),
        longest=float(cable_lengths(robot, poses).max()),
        tension=float(T.max()),
        slackest=float(np.median(T)),
    )


def judge_material(
    material: Material,
    need: RopeNeed,
    robot: CableRobot | None = None,
    poses: Poses | None = None,
) -> MaterialRow:
    """A rope of the section that strength and stiffness ask for, whichever is larger.

    Args:
        robot, poses: for the softest stiffness.
    """
    section = max(
        need.strength / (material.strength * material.strength_share),
        need.axial_stiffness / (material.modulus * material.modulus_share),
    )
    stiffness = section * material.modulus * material.modulus_share
    strength = section * material.strength * material.strength_share
    weight = material.density * section * _GRAVITY
    length = need.longest
    stretch = need.tension * length / stiffness
    softest = math.nan
    if robot is not None and poses is not None:
        # K is in proportion to E A.
        scale = stiffness / robot.axial_stiffness.max()
        K = elastic_stiffness(robot, poses)
        known = stiffness_directions(robot, K, characteristic_length(robot))
        softest = float(scale * known.values.min())
    return MaterialRow(
        material=material,
        section=section,
        diameter=math.sqrt(4.0 * section / (math.pi * _FILLED)),
        mass_per_length=material.density * section,
        axial_stiffness=stiffness,
        strength=strength,
        sag=weight * length**2 / (8.0 * need.slackest),
        sag_error=weight**2 * length**3 / (24.0 * need.slackest**2),
        stretch=stretch,
        stretch_error=STIFFNESS_ERROR * stretch,
        thermal_error=abs(material.expansion) * need.temperature_change * length,
        creep_error=material.creep * length * need.tension / (0.2 * strength),
        softest=softest,
    )


def compare_materials(
    need: RopeNeed,
    robot: CableRobot | None = None,
    poses: Poses | None = None,
    materials: Sequence[Material] = MATERIALS,
) -> list[MaterialRow]:
    """One row a material; see `judge_material`."""
    return [judge_material(material, need, robot, poses) for material in materials]


def recommend_material(rows: Sequence[MaterialRow]) -> MaterialRow:
    """The least error of the longest cable's length, among what bears being wound on a winch."""
    fit = [row for row in rows if row.material.bends]
    require(len(fit) > 0, "materials that bear bending", len(fit), ">= 1")
    return min(fit, key=lambda row: row.length_error)


def material_table(rows: Sequence[MaterialRow]) -> str:
    """The rows as text with units, in columns."""
    head = (
        f"{'material':20}{'rope mm':>8}{'g/m':>7}{'EA kN':>8}{'sag mm':>8}"
        f"{'sag':>7}{'stretch':>9}{'heat':>7}{'creep':>7}{'all mm':>8}  bends"
    )
    lines = [head]
    for row in rows:
        errors = row.sag_error, row.stretch_error, row.thermal_error, row.creep_error
        widths = 7, 9, 7, 7
        lines.append(
            f"{row.material.name:20}{1e3 * row.diameter:8.1f}{1e3 * row.mass_per_length:7.1f}"
            f"{1e-3 * row.axial_stiffness:8.0f}{1e3 * row.sag:8.0f}"
            + "".join(f"{1e3 * e:{w}.2f}" for e, w in zip(errors, widths, strict=True))
            + f"{1e3 * row.length_error:8.2f}  {'yes' if row.material.bends else 'no'}"
        )
    return "\n".join(lines)
