"""The drives: how stiffly the joints are held, and what their torques can do with a payload.

A drive is a position servo: effort = p (q_d - q) + d (v_d - v), cut at the joint's limit. RMS-71
has none (its slave arm is where it is commanded); gains assumed, from the loaded arm:

- The switching line e = -(d / p) e' must be met before it is too late to brake. From a speed v a
  joint stops in v^2 / (2 a), so d / p >= v / (2 a): at 0.06 m/s 2.3 s at the shoulder, where
  1570 N m give 10 t at 10 m 0.013 m/s^2, and 2.8 s at the elbow (1074 N m at 7 m, 0.011 m/s^2).
  With that the loaded arm does not overshoot, though its torque is cut.
- p makes the loaded joint's frequency `STIFFNESS_FREQUENCY`, which with such damping is over-damped
  and lets a joint's largest torque bend it by about 1 mm at 10 m.

The vectors are the arm's: stand (m, N), six joints (rad, N m), prong (m, N).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import SIDES

Array = NDArray[np.float64]

#: Names of the arm vector's entries, which are the plant's joints.
ARM_JOINTS = ("height", "H0", "P0", "P1", "H2", "P2", "R2", "gap")
#: Undamped, of a joint that carries the payload, Hz.
STIFFNESS_FREQUENCY = 0.5
#: Damping by stiffness, s.
DAMPING_TIME = 3.0
#: The same of what carries no swinging payload: the prong.
PRONG_DAMPING_TIME = 0.25
#: Of the prong alone, Hz.
PRONG_FREQUENCY = 2.0
#: The orbiter's translation: of the whole orbiter, Hz.
ORBITER_FREQUENCY = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Drives:
    """Of every entry of the arm vector, (8,) each.

    Attributes:
        stiffness: N/m and N m/rad.
        damping: the same times s.
        effort: limits, N and N m.
        rate: limits, m/s and rad/s.
    """

    stiffness: Array
    damping: Array
    effort: Array
    rate: Array


def prism_unit_moments(across_flats: float, length: float) -> tuple[float, float]:
    """Moments of inertia of a uniform eight-sided prism by its mass, along and across, m^2.

    A regular n-gon of circumradius R has R^2 (2 + cos(2 pi / n)) / 6 about its middle.
    """
    radius = 0.5 * across_flats / math.cos(math.pi / SIDES)
    polar = radius**2 * (2.0 + math.cos(2.0 * math.pi / SIDES)) / 6.0
    return polar, 0.5 * polar + length**2 / 12.0


def carried_inertias(config: RemoteManipulatorConfig) -> Array:
    """What the joints move with the payload in the effector, (8,) kg and kg m^2, roughly.

    The shoulder's joints with the wrist at three quarters of the arm's length, the elbow's with it
    straight ahead, the wrist's and the stand's as they are; the prong alone.
    """
    arm, payload, effector = config.arm, config.payload, config.effector
    mass = payload.mass_kg
    below = (
        arm.arm_2_m
        + effector.palm.length_m
        + config.receptacle.height_m
        + 0.5 * payload.across_flats_m
    )
    along, across = (
        mass * unit for unit in prism_unit_moments(payload.across_flats_m, payload.length_m)
    )
    shoulder = mass * (0.75 * (arm.arm_0_m + arm.arm_1_m)) ** 2 + across
    elbow = mass * arm.arm_1_m**2 + across
    # The wrist's heading axis and roll axis may pass through the payload: its own inertia alone.
    wrist = mass * below**2 + across
    links = arm.shoulder_mass_kg + arm.arm_0_mass_kg + arm.arm_1_mass_kg + arm.wrist_mass_kg
    stand = mass + links + arm.effector_mass_kg + config.stand.mass_kg
    roll = max(across, along)
    return np.array([stand, shoulder, shoulder, elbow, wrist, wrist, roll, effector.prong_mass_kg])


def make_drives(config: RemoteManipulatorConfig) -> Drives:
    """The drives of a machine; see the module's docstring."""
    frequency = np.full(len(ARM_JOINTS), STIFFNESS_FREQUENCY)
    frequency[-1] = PRONG_FREQUENCY
    stiffness = carried_inertias(config) * (2.0 * math.pi * frequency) ** 2
    damping_time = np.full(len(ARM_JOINTS), DAMPING_TIME)
    damping_time[-1] = PRONG_DAMPING_TIME
    arm, stand, effector = config.arm, config.stand, config.effector
    return Drives(
        stiffness=stiffness,
        damping=stiffness * damping_time,
        effort=np.array([stand.force_N, *arm.torques, effector.prong_force_N]),
        rate=np.array([stand.rate_m_s, *arm.rates, effector.prong_rate_m_s]),
    )


def orbiter_gains(config: RemoteManipulatorConfig) -> tuple[float, float]:
    """Stiffness, N/m, and damping, N s/m, of the orbiter's translation: critically damped.

    Raised until it may brake in time, as the module's docstring has it.
    """
    orbiter = config.orbiter
    stiffness = orbiter.mass_kg * (2.0 * math.pi * ORBITER_FREQUENCY) ** 2
    critical = 2.0 / (2.0 * math.pi * ORBITER_FREQUENCY)
    braking = orbiter.rate_m_s * orbiter.mass_kg / (2.0 * orbiter.force_N)
    return stiffness, stiffness * max(critical, braking)


def stopping_distance(speed: ArrayLike, acceleration: ArrayLike) -> Array:
    """How far something goes on while it brakes, m: v^2 / (2 a), with m/s and m/s^2."""
    return np.asarray(0.5 * np.square(speed) / np.asarray(acceleration))


def step_response(time: ArrayLike, inertia: float, stiffness: float, damping: float) -> Array:
    """What an uncut servo's joint has done of a unit step, (...), `time` (...) s after it.

    The closed form of J q'' + d q' + p q = p, over-damped: d^2 > 4 p J.
    """
    t = np.asarray(time, dtype=np.float64)
    middle = 0.5 * damping / inertia
    spread = math.sqrt(middle**2 - stiffness / inertia)
    # The slow root by Vieta's formula: the difference of two like numbers would lose its digits.
    fast = -(middle + spread)
    slow = stiffness / inertia / fast
    return np.asarray(1.0 + (slow * np.exp(fast * t) - fast * np.exp(slow * t)) / (fast - slow))
