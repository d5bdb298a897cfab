"""A platform's motion as a page to look at: its cables move along, a broken one hangs down."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.runs.station_flight import bay_boxes
from pips_drake.cable_robot.station import add_plant
from pips_drake.cable_robot.systems.cable_visualizer import CableVisualizer
from pips_drake.twin.replay import Bookmark, LineInSpace, Replay

Array = NDArray[np.float64]

#: Where the posts stand, z, m.
_FLOOR = -3.0


def write_platform_replay(
    file: Path,
    robot: CableRobot,
    time: ArrayLike,
    poses: Poses,
    *,
    broken: ArrayLike | None = None,
    sample_rate: float,
    speed: float,
    eye: ArrayLike,
    target: ArrayLike,
    title: str,
    note: str = "",
    lines: Sequence[LineInSpace] = (),
    bookmarks: Sequence[Bookmark] = (),
) -> None:
    """Writes `replay.html`: platform, cables, posts, doors and bay.

    Args:
        time: of the poses, ascending, (N,) s.
        poses: of the platform, N.
        broken: above 0.5 where a cable is, (N, M); None: none is.
        sample_rate: samples a simulated second; the nearest pose is taken.
        speed: simulated seconds a second of watching.
        eye, target: where one looks from and to at first, (3,) m.
        title, note: of the page.
        lines: that stay.
        bookmarks: moments to jump to.
    """
    times = np.asarray(time, dtype=np.float64)
    shape = (len(times), robot.cables)
    gone = np.broadcast_to(np.asarray(0.0 if broken is None else broken, dtype=float), shape)
    builder = DiagramBuilder()
    machine = add_plant(builder, robot, time_step=0.01, obstacles=bay_boxes(), floor=_FLOOR)
    drawn = builder.AddNamedSystem(
        "cables", CableVisualizer(robot, scene_graph=machine.scene_graph)
    )
    state_port = machine.plant.get_state_output_port(machine.model)
    builder.Connect(state_port, drawn.GetInputPort("platform_state"))
    builder.ExportInput(drawn.GetInputPort("broken"), "broken")
    builder.Connect(
        drawn.GetOutputPort("geometry_pose"),
        machine.scene_graph.get_source_pose_port(drawn.source_id),
    )
    builder.ExportOutput(machine.scene_graph.get_query_output_port(), "query")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = machine.plant.GetMyMutableContextFromRoot(context)
    quaternions = np.roll(Rotation.from_matrix(poses.rotation).as_quat(), 1, axis=1)
    positions = np.hstack([quaternions, poses.position])
    query = diagram.GetOutputPort("query")

    def show(row: int) -> None:
        machine.plant.SetPositions(plant_context, machine.model, positions[row])
        diagram.GetInputPort("broken").FixValue(context, gone[row])
        # The cables' places are state, which follows the platform by events.
        diagram.ExecuteInitializationEvents(context)

    show(0)
    replay = Replay(query.Eval(context), sample_rate=sample_rate)
    for line in lines:
        replay.add_line(line)
    count = 1 + int(np.ceil((times[-1] - times[0]) * sample_rate - 1e-9))
    for wanted in times[0] + np.arange(count) / sample_rate:
        show(int(np.argmin(np.abs(times - wanted))))
        replay.add_sample(query.Eval(context))
    replay.write(
        file,
        eye=eye,
        target=target,
        title=title,
        note=note,
        start=float(times[0]),
        speed=speed,
        bookmarks=bookmarks,
    )
