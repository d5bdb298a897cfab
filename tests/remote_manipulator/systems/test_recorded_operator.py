"""A recording gives its own channels at its own times, and repeats a run that it was made of."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import (
    AngleScaling,
    angle_scaling,
    decode_channels,
    encode_frame,
)
from pips_drake.remote_manipulator.kinematics import nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs, frames_of
from pips_drake.remote_manipulator.operator_recording import OperatorRecording
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.run import load_setup, make_station, run_station
from pips_drake.remote_manipulator.runs.run_files import write_series
from pips_drake.remote_manipulator.scenario import OperatorConfig, RemoteManipulatorScenario
from pips_drake.remote_manipulator.script import ScriptStep
from pips_drake.remote_manipulator.systems.recorded_operator import RecordedOperator

from ..program_world import CONFIG, DOWN, PALM_TOP, STOWED

SCALING = angle_scaling(CONFIG.arm)
FRAME = 0.05


def recording(times, inputs) -> OperatorRecording:
    return OperatorRecording(times=np.array(times), frames=frames_of(inputs))


def still(**inputs) -> OperatorInputs:
    return OperatorInputs(angles=inputs.pop("angles", np.zeros(6)), **inputs)


def played(system: RecordedOperator, seconds: float) -> dict[str, np.ndarray]:
    """What a system gives, frame by frame."""
    builder = DiagramBuilder()
    builder.AddSystem(system)
    logs = {
        name: LogVectorOutput(system.GetOutputPort(name), builder, FRAME)
        for name in ("channels", "finished")
    }
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    context = simulator.get_context()
    return {name: log.FindLog(context).data().T for name, log in logs.items()}


def test_every_frame_has_what_the_recording_has_at_its_time():
    rng = np.random.default_rng(3)
    times = [0.0, 0.35, 0.95, 2.0]
    script = [
        still(angles=rng.uniform(-1.0, 1.0, 6), prong=int(prong), station=station)
        for prong, station in zip((0, 1, -1, 0), "ACFM", strict=True)
    ]
    made = recording(times, script)
    channels = played(RecordedOperator(made, SCALING), 2.0)["channels"]
    assert len(channels) == 41
    frames = decode_channels(channels, SCALING)
    # Frames 7, 19 and 40 are at 0.35, 0.95 and 2 s, which no sum of twentieths is to the last bit.
    rows = np.searchsorted([7, 19, 40], np.arange(41), side="right")
    assert frames.column("prong").tolist() == [(0, 1, -1, 0)[row] for row in rows]
    angles = np.array([one.angles for one in script])
    for joint in range(6):
        expected = np.interp(np.arange(41) * FRAME, times, angles[:, joint])
        # Roundings of volts and of times.
        assert frames.angles[:, joint] == pytest.approx(expected, abs=1e-12)


def test_it_is_finished_from_its_last_row_on_and_then_stays():
    made = recording([0.0, 0.5], [still(), still(telescope=1)])
    log = played(RecordedOperator(made, SCALING), 1.0)
    assert log["finished"][:, 0].tolist() == [0.0] * 10 + [1.0] * 11
    assert np.all(log["channels"][10:] == encode_frame(still(telescope=1), SCALING))


def test_an_angle_that_no_volts_can_say_is_refused_before_the_run():
    short = AngleScaling(radians_per_volt=np.full(6, 0.05))
    made = recording([0.0, 1.0], [still(), still(angles=np.full(6, 0.6))])
    with pytest.raises(InputError, match=r"frame 2: H0 = 34\.3775 deg; must be within"):
        RecordedOperator(made, short)


def scenario(operator: OperatorConfig) -> RemoteManipulatorScenario:
    """The effector open over the stowed payload's bar, 20 cm up."""
    palm = STOWED[1] - [0.0, 0.0, PALM_TOP + 0.2]
    angles = nearest_angles(CONFIG.arm, palm, DOWN, 4.0, CONFIG.arm.home)
    made = RemoteManipulatorScenario(
        operator=operator, stand_height_m=4.0, angles_deg=np.degrees(angles).tolist()
    )
    made.validate()
    return made


def run(made: RemoteManipulatorScenario, folder=None):
    setup = load_setup(made, folder=folder)
    station = make_station(setup, make_operator(made, setup, folder=folder).system)
    return run_station(station, duration=made.duration_s or 600.0)


@pytest.mark.slow
def test_a_runs_own_recording_does_the_same_task_again(tmp_path):
    steps = [
        ScriptStep(do="descend", speed_m_s=0.05),
        ScriptStep(do="close"),
        ScriptStep(do="carry", by_m=[0.0, 0.0, -0.3]),
        ScriptStep(do="open"),
    ]
    first = run(scenario(OperatorConfig(script=steps)))
    assert first.finished
    assert first.data.phases[:2] == ["stowed", "extraction"]
    write_series(tmp_path, first.data, CONFIG)
    config = OperatorConfig(kind="recording", recording="operator.csv")
    again = run(scenario(config), folder=tmp_path)
    assert again.finished
    assert again.data.phase.tobytes() == first.data.phase.tobytes()
    assert again.data.time.tobytes() == first.data.time.tobytes()
    # Angles go through degrees and back: one rounding, 1e-15 rad at an arm of 15 m, which contact
    # and solver tolerances may enlarge to what the solver itself leaves open.
    assert np.max(np.abs(again.data.payload - first.data.payload)) < 1e-6
