"""How hard a robot hits something: closing speed, effective mass, energy and impulse of the blow.

At the instant of first contact, with n the unit normal from what is hit towards the robot, and J
the Jacobian of the relative velocity of the two witness points,

    closing speed   v = -n . J qdot,
    effective mass  m = 1 / (n^T J M^-1 J^T n),
    energy          E = m v^2 / 2,
    impulse         p = m v:

the mass that a free particle would have that answers a push at that point along n as the whole
mechanism does (O. Khatib, "Inertial properties in robotic manipulation", Int. J. Robotics Research
14, 1995, section 3), and what a plastic blow takes from the motion along n. It is the blow alone,
as if it took no time: what drives, gravity and stops push afterwards is not in it, nor friction,
nor how soft the parts are. What is hit counts as whatever the plant has it be: fixed bodies do not
give way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.framework import Context

    from pips_drake.twin.clearance import LeastDistance

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Impact:
    """A blow at the instant of first contact.

    Attributes:
        time: s.
        pair: the bodies' scoped names, the robot's first.
        point: midway between the witness points, in the world, (3,) m.
        normal: unit vector from what is hit towards the robot, in the world, (3,).
        closing_speed: along the normal, m/s; positive when closing in.
        effective_mass: along the normal, kg; infinite where nothing can move along it.
    """

    time: float
    pair: tuple[str, str]
    point: Array
    normal: Array
    closing_speed: float
    effective_mass: float

    @property
    def energy(self) -> float:
        """Kinetic energy along the normal, J; 0 when nothing closes in."""
        return 0.5 * self.impulse * self.closing_speed if self.closing_speed > 0.0 else 0.0

    @property
    def impulse(self) -> float:
        """Of a plastic blow along the normal, N s; 0 when nothing closes in."""
        return self.effective_mass * self.closing_speed if self.closing_speed > 0.0 else 0.0

    def summary(self) -> dict[str, Any]:
        """For `summary.json`."""
        return {
            "hit_pair": list(self.pair),
            "hit_time_s": self.time,
            "hit_point_m": self.point,
            "hit_normal": self.normal,
            "hit_closing_speed_m_per_s": self.closing_speed,
            "hit_effective_mass_kg": self.effective_mass,
            "hit_energy_j": self.energy,
            "hit_impulse_n_s": self.impulse,
        }

    def sentence(self) -> str:
        """What was hit, when, how hard."""
        robot, other = self.pair
        if self.closing_speed <= 0.0:
            return f"{robot} touches {other} at {self.time:.3f} s without closing in"
        speed, mass, energy, impulse = map(
            _three_digits, (self.closing_speed, self.effective_mass, self.energy, self.impulse)
        )
        return (
            f"{robot} hit {other} at {self.time:.3f} s: closing in at {speed} m/s with {mass} kg "
            f"along the normal, {energy} J, {impulse} N s"
        )


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"


def find_impact(plant: MultibodyPlant, context: Context, nearest: LeastDistance) -> Impact:
    """The blow of a pair that touches, in a plant that is posed there and has its velocities.

    Args:
        context: of the plant; its time is the blow's.
        nearest: the pair that touches (`ClearanceQuery.least`).
    """
    from pydrake.multibody.tree import JacobianWrtVariable

    assert nearest.bodies is not None and nearest.pair, "nothing is near enough to be hit"
    world = plant.world_frame()
    relative = np.zeros((3, plant.num_velocities()))
    for sign, body, point in zip((1.0, -1.0), nearest.bodies, nearest.points, strict=True):
        frame = plant.get_body(body).body_frame()
        p_BP = plant.CalcPointsPositions(context, world, point, frame)
        relative += sign * plant.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, frame, p_BP, world, world
        )
    along = nearest.normal @ relative
    mass_matrix = plant.CalcMassMatrixViaInverseDynamics(context)
    mobility = float(along @ np.linalg.solve(mass_matrix, along))
    return Impact(
        time=float(context.get_time()),
        pair=nearest.pair,
        point=nearest.points.mean(axis=0),
        normal=np.array(nearest.normal),
        # Not minus zero where nothing moves.
        closing_speed=0.0 - float(along @ plant.GetVelocities(context)),
        effective_mass=1.0 / mobility if mobility > 0.0 else math.inf,
    )
