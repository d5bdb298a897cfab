"""The same plan under tolerances: draws of errors, adverse corners, what is left of clearance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.drives import drive_efforts, drive_limits
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.mounting import mounting_gravity
from pips_drake.serpentine.plan import Plan, make_plan
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import CheckConfig, SerpentineScenario
from pips_drake.serpentine.statics import holding_efforts, sag
from pips_drake.serpentine.station import (
    SerpentineSetup,
    arm_pose,
    gravity_in_frame_0,
    load_setup,
)
from pips_drake.serpentine.tolerances import (
    Errors,
    arm_with_errors,
    draw,
    half_widths,
    worst_of,
)
from pips_drake.twin.clearance import ClearanceQuery, LeastDistance

Array = NDArray[np.float64]

#: What the table says of each case.
COLUMNS = (
    "verdict",
    "clearance_sampled_min_m",
    "clearance_min_pair",
    "clearance_min_tip_arc_length_m",
    "payload_clearance_sampled_min_m",
    "self_clearance_sampled_min_m",
    "drive_effort_max_fraction",
    "tip_displacement_max_m",
    "payload_x_m",
    "payload_y_m",
    "payload_z_m",
    "sag_share",
    "failures",
)
#: What a case is: the plan as it stands; the corner that takes most from the least clearance, and
#: from the least clearance to the payload, to first order; a draw.
NOMINAL, ADVERSE, ADVERSE_PAYLOAD, DRAW = "nominal", "adverse", "adverse_payload", "draw"
#: How far distances are looked for, m.
_REACH = 2.0
#: Step of the differences, m and rad and shares: distances are of meters, to 1e-15.
_STEP = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Believed:
    """What the plan believes.

    Attributes:
        config: the arm's file.
        payload: scoped name of the body that may stand elsewhere; empty for none.
    """

    scenario: SerpentineScenario
    setup: SerpentineSetup
    config: ArmFile
    plan: Plan
    payload: str

    @property
    def joints(self) -> Array:
        """Of the plan, (N, J)."""
        return self.plan.joints


def run_margin_case(
    scenario: SerpentineScenario,
    config: ArmFile,
    folder: Path,
    scene_file: Path | None,
    task: Mapping[str, Any],
) -> dict[str, Any]:
    """Judges the plan with one set of errors.

    Args:
        folder: of the case's own arm and path.
        task: kind, tolerances, seed, draw, payload.

    Raises:
        NotFollowableError: there is no plan.
    """
    setup = load_setup(scenario, folder=folder, scene_file=scene_file)
    plan = make_plan(setup.arm, setup.path)
    if not plan.followable:
        raise NotFollowableError(plan.failures[0])
    believed = Believed(
        scenario=scenario, setup=setup, config=config, plan=plan, payload=task["payload"]
    )
    widths = half_widths(setup.arm, task["tolerances"])
    kind = task["kind"]
    if kind == DRAW:
        values = draw(widths, task["seed"], task["draw"])
    elif kind == NOMINAL:
        values = np.zeros_like(widths)
    else:
        values = _adverse(believed, widths, payload_alone=kind == ADVERSE_PAYLOAD)
    errors = Errors.from_vector(setup.arm, values)
    return _judge(believed, errors)


def _judge(believed: Believed, errors: Errors) -> dict[str, Any]:
    pairs, efforts, joints = _postures(believed, errors)
    beside: dict[str, Any] = {}
    if believed.payload and believed.setup.scene_file is not None:
        there, _, _ = _postures(believed, errors, only=believed.payload)
        beside["payload_clearance_sampled_min_m"] = min(pair.distance for pair, _ in there)
    arm = arm_with_errors(believed.config, errors)
    scene = [pair for pair, _ in pairs]
    k = int(np.argmin([pair.distance for pair in scene]))
    own = min(pair.distance for _, pair in pairs)
    tip = kinematics.spine_points(arm, joints)[:, -1]
    wanted = kinematics.spine_points(believed.setup.arm, believed.joints)[:, -1]
    numbers = {
        # Beyond its range a query says nothing more.
        "clearance_sampled_min_m": scene[k].distance if scene[k].pair else None,
        "clearance_min_pair": " to ".join(scene[k].pair),
        "clearance_min_tip_arc_length_m": believed.plan.solution.tip_arc_lengths[k],
        "self_clearance_sampled_min_m": own,
        "drive_effort_max_fraction": efforts,
        "tip_displacement_max_m": np.linalg.norm(tip - wanted, axis=-1).max(),
        "payload_x_m": errors.payload[0],
        "payload_y_m": errors.payload[1],
        "payload_z_m": errors.payload[2],
        "sag_share": errors.sag_share,
    }
    failures = _failures(believed.scenario.checks, scene[k], own, efforts)
    return (
        numbers
        | beside
        | {"verdict": "fail" if failures else "pass", "failures": "; ".join(failures)}
    )


def _failures(checks: CheckConfig, nearest: LeastDistance, own: float, efforts: float) -> list[str]:
    found = []
    if nearest.distance < checks.clearance_min_mm * 1e-3:
        robot, other = nearest.pair or ("the arm", "the scene")
        found.append(
            f"{robot} comes within {nearest.distance * 1e3:.1f} mm of {other}; must be >= "
            f"{checks.clearance_min_mm:g} mm"
        )
    if own < checks.self_clearance_min_mm * 1e-3:
        found.append(
            f"the arm comes within {own * 1e3:.1f} mm of itself; must be >= "
            f"{checks.self_clearance_min_mm:g} mm"
        )
    if efforts > checks.force_fraction_max:
        found.append(
            f"a drive needs {100.0 * efforts:.0f} % of its effort limit; must be <= "
            f"{100.0 * checks.force_fraction_max:g} %"
        )
    return found


def _postures(
    believed: Believed, errors: Errors, *, only: str = ""
) -> tuple[list[tuple[LeastDistance, LeastDistance]], float, Array]:
    """Least distances at the plan's postures, the largest share of effort, and the joints (N, J).

    Args:
        only: scoped name of a body of the scene; distances to the rest of it do not count.
    """
    scenario, setup = believed.scenario, believed.setup
    arm = arm_with_errors(believed.config, errors)
    displaced = []
    if errors.payload.any():
        offset = [float(value) * 1e3 for value in errors.payload]
        displaced = [FaultConfig(kind="payload_displaced", body=believed.payload, offset_mm=offset)]
    # The scenario's own faults are of its run, not of what is studied here.
    placed = place_arm(replace(scenario, faults=displaced), replace(setup, arm=arm))
    # Far enough to say how tight every case is, whatever the scenario's reach.
    query = ClearanceQuery(placed.plant, [placed.model], max_distance=_REACH, scene_body=only)
    gravity = gravity_in_frame_0(placed.plant)
    joints = _standing(believed, errors, gravity)
    pairs = [query.least(scene) for scene in placed.posed(joints)]
    efforts = drive_efforts(arm, joints, holding_efforts(arm, joints, gravity))
    return pairs, float((np.abs(efforts) / drive_limits(arm)[3]).max()), joints


def _standing(believed: Believed, errors: Errors, gravity: Array) -> Array:
    """Joints (N, J) where the plan's are sent: off by the encoders' errors and by what sags."""
    arm = believed.setup.arm
    give = sag(arm, believed.joints, gravity)
    standing: Array = believed.joints + errors.joints - errors.sag_share * give
    return standing


def _adverse(believed: Believed, widths: Array, *, payload_alone: bool) -> Array:
    """The corner of the tolerances that takes most from the tightest posture, to first order.

    Where nothing is in range, nothing is adverse: the nominal case.
    """
    setup, scenario = believed.setup, believed.scenario
    nominal = Errors.from_vector(setup.arm, np.zeros_like(widths))
    only = believed.payload if payload_alone else ""
    pairs, _, _ = _postures(believed, nominal, only=only)
    near = [(pair.distance, k, pair) for k, (pair, _) in enumerate(pairs) if pair.pair]
    if not near:
        return np.zeros_like(widths)
    _, k, pair = min(near, key=lambda item: item[:2])
    bodies = [body.name for body in setup.arm.bodies]
    assert len(pair.pair) == 2  # filtered above
    robot, other = pair.pair
    body = bodies.index(robot.rpartition("::")[2])
    X_W0 = arm_pose(scenario, setup)
    gravity = mounting_gravity(scenario.mounting)
    at = _with_posture(believed, k)
    frame = kinematics.frames(setup.arm, _standing(at, nominal, gravity))[0, body]
    witness = X_W0.inverse() @ pair.points[0]
    local = frame[:3, :3].T @ (witness - frame[:3, 3])
    normal = X_W0.rotation().inverse() @ pair.normal  # from the scene towards the arm

    def gap(values: Array) -> float:
        """How much farther the witness on the arm is from the scene's, along their normal, m."""
        errors = Errors.from_vector(setup.arm, values)
        arm = arm_with_errors(believed.config, errors)
        X = kinematics.frames(arm, _standing(at, errors, gravity))[0, body]
        moved = errors.payload if other == believed.payload else np.zeros(3)
        return float(normal @ (X[:3, :3] @ local + X[:3, 3] - witness - moved))

    # Forward differences where an offset would become negative are still differences: a tolerance
    # is far larger than the step.
    steps = _STEP * np.eye(widths.size)
    gradient = np.array([gap(step) - gap(-step) for step in steps]) / (2.0 * _STEP)
    gradient[np.abs(gradient) < _STEP] = 0.0  # roundings have no direction
    return worst_of(widths, gradient)


def _with_posture(believed: Believed, k: int) -> Believed:
    """The same with posture `k` alone."""
    solution = believed.plan.solution
    one = make_plan(
        believed.setup.arm,
        believed.setup.path,
        tip_arc_lengths=solution.tip_arc_lengths[k : k + 1],
    )
    return replace(believed, plan=one)


def margin_tasks(
    scenario: SerpentineScenario, tolerances: Mapping[str, float], *, draws: int, seed: int
) -> list[dict[str, Any]]:
    """What each case of a study of margins adds to its task.

    Raises:
        InputError: a payload is to stand elsewhere, and the scenario names none.
    """
    payload = scenario.camera.target_body
    if tolerances.get("payload_mm", 0.0) > 0.0 and not (payload and scenario.scene):
        raise InputError(
            "tolerances.payload_mm: the scenario must have a scene, and camera.target_body must "
            "name the payload in it"
        )
    kinds = [(NOMINAL, 0), (ADVERSE, 0), (ADVERSE_PAYLOAD, 0)]
    kinds += [(DRAW, index) for index in range(1, draws + 1)]
    return [
        {
            "kind": kind,
            "draw": index,
            "seed": seed,
            "payload": payload,
            "tolerances": dict(tolerances),
        }
        for kind, index in kinds
    ]
