"""A serpentine station on the bench: built, advanced and read by name."""

from __future__ import annotations

import numpy as np
from pydrake.systems.analysis import Simulator

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import MakeSerpentineStation, load_setup

INCH = 0.0254
PLANT_STEP = 1.0 / 512.0


class Bench:
    """A station with its simulator, and its outputs by name."""

    def __init__(self, scenario, *, command=None, start=None):
        self.scenario, self.setup = scenario, load_setup(scenario)
        self.station = MakeSerpentineStation(scenario, setup=self.setup)
        self.simulator = Simulator(self.station)
        self.context = self.simulator.get_mutable_context()
        self.plant = self.station.GetSubsystemByName("plant")
        if command is not None:
            self.command(command)
        if start is not None:
            model = self.plant.GetModelInstanceByName("prototype")
            mine = self.plant.GetMyMutableContextFromRoot(self.context)
            self.plant.SetPositions(mine, model, start)
        self.simulator.Initialize()

    def command(self, word):
        self.station.GetInputPort("tip_path_source.command").FixValue(self.context, [word])

    def __getitem__(self, port):
        return np.array(self.station.GetOutputPort(port).Eval(self.context))

    @property
    def joints(self):
        return self["plant.state"][:18]

    def advance(self, duration):
        """Goes on for whole plant steps, and half of one, so that all updates have happened."""
        steps = round((self.context.get_time() + duration) / PLANT_STEP - 0.5)
        self.simulator.AdvanceTo((steps + 0.5) * PLANT_STEP)

    def holding_efforts(self, q):
        """What Drake's gravity takes to hold the arm at q, (18,), N and Nm."""
        mine = self.plant.CreateDefaultContext()
        self.plant.SetPositions(mine, self.plant.GetModelInstanceByName("prototype"), q)
        return -self.plant.CalcGravityGeneralizedForces(mine)[: len(q)]

    @property
    def stiffness(self):
        """Gains in the plant, (18,), N/m and Nm/rad."""
        actuators = [self.plant.get_joint_actuator(i) for i in self.plant.GetJointActuatorIndices()]
        return np.array([actuator.get_controller_gains().p for actuator in actuators])


def scenario(**changes):
    """Trajectory 4's arcs, no scene; dotted names with __ for the dots."""
    made = SerpentineScenario(path="trajectory_4_arcs")
    for name, value in changes.items():
        *parents, leaf = name.split("__")
        target = made
        for parent in parents:
            target = getattr(target, parent)
        assert hasattr(target, leaf)
        setattr(target, leaf, value)
    return made


def load_home():
    """Follow-the-leader's joints at trajectory 4's home."""
    setup = load_setup(scenario())
    return setup.solver.solve(setup.path, [setup.path.home_arc_length]).joints[0]


def spine_distance(arm, q, wanted):
    """Farthest spine point from where it is wanted, m."""
    points = kinematics.spine_points(arm, np.array([q, wanted]))
    return np.linalg.norm(points[0] - points[1], axis=1).max()
