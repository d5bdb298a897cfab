"""Finds the first contact of a run among the plant's steps, and how hard it was."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.primitives import VectorLogSink

from pips_drake.serpentine.runs.placed_arm import PlacedArm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.twin.clearance import ClearanceQuery
from pips_drake.twin.impact import Impact, find_impact
from pips_drake.twin.motion_record import MotionRecorder, RecordedSteps
from pips_drake.twin.simulation import STRIDE


def steps_to_keep(scenario: SerpentineScenario) -> float:
    """For how long a run's steps must be kept until its log tells of a contact in them, s."""
    clocks = scenario.clocks
    return STRIDE + 2.0 / clocks.clearance_hz + 2.0 / clocks.record_hz


class ContactWatch:
    """Collects a run's motion, and keeps the steps in which something was first touched.

    Args:
        recorder: of the motion.
        clearances: log of the monitor's clearances.
    """

    def __init__(self, recorder: MotionRecorder, clearances: VectorLogSink) -> None:
        self._recorder, self._clearances = recorder, clearances
        self._seen = 0
        self.touched = False

    def __call__(self, context: Context) -> None:
        """Looks at what was logged since the last call; `context` is the root's."""
        self._recorder.collect(context)
        if self.touched:
            return
        rows = self._clearances.FindLog(context).data()[[0, 2], self._seen :]
        self._seen += rows.shape[1]
        # NaN is no distance.
        self.touched = bool(np.any(rows <= 0.0))
        if self.touched:
            self._recorder.freeze()


def find_hit(placed: PlacedArm, steps: RecordedSteps) -> Impact | None:
    """The blow at the first step in which arm and scene, or the arm and itself, touch.

    Contact acts on the plant's next step, so the velocities with which a first step in contact was
    reached are those before the blow.

    Args:
        placed: arm and scene.
        steps: of the arm's state.

    Returns:
        None if nothing touches.
    """
    plant = placed.plant
    root = placed.diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    mine = placed.scene_graph.GetMyContextFromRoot(root)
    port = placed.scene_graph.get_query_output_port()
    for time, state in zip(steps.times, steps.states, strict=True):
        plant.SetPositionsAndVelocities(context, placed.model, state)
        query = port.Eval(mine)
        if query.HasCollisions():
            root.SetTime(float(time))
            # Nothing that touches is farther off than the engine's error (1.9 mm measured).
            near = ClearanceQuery(plant, [placed.model], max_distance=0.01)
            nearest = min(near.least(query), key=lambda one: one.distance)
            return None if nearest.bodies is None else find_impact(plant, context, nearest)
    return None
