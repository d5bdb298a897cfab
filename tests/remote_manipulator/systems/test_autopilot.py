"""The autopilot as a system does what the script's own frames say, from state alone."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, decode_frame
from pips_drake.remote_manipulator.autopilot import Autopilot as Pilot
from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.script import ScriptStep
from pips_drake.remote_manipulator.systems.autopilot import Autopilot

from ..program_world import CONFIG, STOWED, arm_over, cae_pose

ARM = arm_over(STOWED, up=0.3)
SCALING = angle_scaling(CONFIG.arm)
SCRIPT = [
    ScriptStep(do="wait", seconds=0.2),
    ScriptStep(do="camera", station="G", pan_deg=2.0),
    ScriptStep(do="descend", speed_m_s=0.1),
    ScriptStep(do="close", seconds=1.0),
]


class Watched:
    """The system in a simulator, before an arm that does not move."""

    def __init__(self, script=SCRIPT, phase: Phase = Phase.STOWED) -> None:
        self.pilot = Pilot(CONFIG, script, station=2)
        self.system = Autopilot(self.pilot, angles=ARM[1:7])
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        for name, values in (
            ("phase", [float(phase)]),
            ("arm_measured", ARM),
            ("payload_pose", [1.0, 0.0, 0.0, 0.0, *STOWED[1]]),
            ("cae_pose", [1.0, 0.0, 0.0, 0.0, *cae_pose()[1]]),
        ):
            self.system.GetInputPort(name).FixValue(self.context, values)

    def output(self, name: str) -> np.ndarray:
        return np.array(self.system.GetOutputPort(name).Eval(self.context))

    def inputs(self):
        return decode_frame(self.output("channels"), SCALING)


def test_before_the_first_frame_the_master_arm_is_where_the_arm_is():
    watched = Watched()
    inputs = watched.inputs()
    # Ten volts are half a turn: one rounding.
    assert inputs.angles == pytest.approx(ARM[1:7], abs=1e-14)
    assert (inputs.station, inputs.prong) == ("C", 0)
    assert (watched.output("step")[0], watched.output("finished")[0]) == (0.0, 0.0)
    assert not watched.system.HasAnyDirectFeedthrough()


def test_every_frame_is_the_pilots_own():
    watched = Watched()
    seen = Seen(phase=Phase.STOWED, arm=ARM, X_RP=STOWED, X_RC=cae_pose())
    state = watched.pilot.first_state(ARM[1:7])
    steps = []
    for frame in range(120):
        # Between the updates of two frames.
        watched.simulator.AdvanceTo((frame + 0.5) * 0.05)
        state, expected = watched.pilot.advance(state, seen)
        found = watched.inputs()
        assert found.angles == pytest.approx(expected.angles, abs=1e-14)
        assert (found.station, found.pan, found.prong) == (
            expected.station,
            expected.pan,
            expected.prong,
        )
        assert watched.output("step")[0] == state.step
        steps.append(state.step)
    assert sorted(set(steps)) == [0, 1, 2]


def test_it_is_finished_when_the_payload_is_held_and_all_steps_are_done():
    watched = Watched([ScriptStep(do="close")], Phase.EXTRACTION)
    watched.simulator.AdvanceTo(0.01)
    assert watched.output("finished")[0] == 1.0
    closing = watched.inputs()
    assert closing.prong == 1
    watched.simulator.AdvanceTo(0.06)
    assert watched.inputs().prong == 0
