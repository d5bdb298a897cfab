"""A plant that a test drives itself: desired states and attachments are what it last wrote."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.phases import SUPPORTS
from pips_drake.remote_manipulator.station.attachments import AttachmentMonitor
from pips_drake.remote_manipulator.station.plant import PlantSettings, make_plant

CONFIG = load_configuration()
#: The effector points down, with its z2 along the payload: the palm holds the bar.
DOWN = np.column_stack([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
#: From the palm's top (end of arm 2) to the payload's middle when the bar is 10 mm below the palm.
BELOW = 0.15 + 0.01 + 0.40 + 0.5 * 4.2672


def holding(palm, *, height=3.0, near=None):
    """The arm vector with the palm's top at `palm`, pointing down, the fingers closed."""
    q = nearest_angles(CONFIG.arm, palm, DOWN, height, CONFIG.arm.home if near is None else near)
    assert q is not None, palm
    return np.array([height, *q, CONFIG.effector.prong_closed_gap_m])


class Bench:
    """The plant in a running simulator, with the monitor of its welds."""

    def __init__(self, *, grasped_pose=None, **settings):
        builder = DiagramBuilder()
        self.machine = make_plant(builder, CONFIG, PlantSettings(**settings))
        self.plant = self.machine.plant
        rest = np.concatenate([self.machine.initial_arm_vector, np.zeros(8)])
        support = SUPPORTS.index(self.machine.settings.support)
        self._arm = builder.AddSystem(ConstantVectorSource(rest))
        self._asked = builder.AddSystem(ConstantVectorSource([0.0, support, 0.0]))
        arm_port = self.plant.get_desired_state_input_port(self.machine.arm)
        builder.Connect(self._arm.get_output_port(), arm_port)
        self._orbiter = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
        if self.machine.orbiter_motion is not None:
            port = self.plant.get_desired_state_input_port(self.machine.orbiter_motion)
            builder.Connect(self._orbiter.get_output_port(), port)
        self.simulator = Simulator(builder.Build())
        self.root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.monitor = AttachmentMonitor(
            self.machine, self._asked, port="y0", grasped_pose=grasped_pose
        )
        self.monitor.initialize(self.root)
        self.simulator.set_monitor(self.monitor.monitor)
        self.simulator.Initialize()

    def _write(self, source, values):
        source.get_mutable_source_value(source.GetMyMutableContextFromRoot(self.root)).set_value(
            np.asarray(values, dtype=float)
        )

    def send(self, arm_vector, rates=None):
        self._write(
            self._arm, np.concatenate([arm_vector, np.zeros(8) if rates is None else rates])
        )

    def send_orbiter(self, offset, velocity=(0.0, 0.0, 0.0)):
        self._write(self._orbiter, np.concatenate([offset, velocity]))

    def ask(self, *, grasped, support="none", resets=0):
        self._write(self._asked, [float(grasped), SUPPORTS.index(support), resets])

    def run(self, duration):
        self.simulator.AdvanceTo(self.root.get_time() + duration)

    def follow(self, times, vectors):
        """Goes through arm vectors at times from now, as the slave arm; the palm's error, m."""
        start, worst, parts = self.root.get_time(), 0.0, 5
        for k in range(1, len(times)):
            rates = (vectors[k] - vectors[k - 1]) / (times[k] - times[k - 1])
            for share in np.arange(1, parts + 1) / parts:
                self.send(vectors[k - 1] + share * (vectors[k] - vectors[k - 1]), rates)
                at = times[k - 1] + share * (times[k] - times[k - 1])
                self.simulator.AdvanceTo(start + at)
            worst = max(worst, float(np.linalg.norm(self.palm() - palm_of(vectors[k]))))
        self.send(vectors[-1])
        return worst

    def step(self):
        self.run(self.machine.settings.time_step)

    def arm_vector(self):
        return self.plant.GetPositions(self.context, self.machine.arm)

    def palm(self):
        return palm_of(self.arm_vector())

    def payload(self):
        """X_WP."""
        return self.plant.EvalBodyPoseInWorld(self.context, self.machine.payload_body)

    def payload_in(self, frame):
        return self.plant.CalcRelativeTransform(
            self.context, frame, self.machine.payload_body.body_frame()
        )

    def positions(self):
        return self.plant.GetPositions(self.context)

    def penetrations(self):
        query = self.plant.get_geometry_query_input_port().Eval(self.context)
        inspector = query.inspector()
        return [
            (inspector.GetName(pair.id_A), inspector.GetName(pair.id_B), pair.depth)
            for pair in query.ComputePointPairPenetration()
            # What lies against each other by design may do so by a rounding error.
            if pair.depth > 1e-6
        ]


def palm_of(arm_vector):
    return forward_kinematics(CONFIG.arm, arm_vector[1:7], arm_vector[0]).palm


def ramped(length, speed, acceleration, period=0.05):
    """Times and distances of a motion from rest to rest, by twos of a straight line."""
    ramp = speed / acceleration
    end = length / speed + ramp
    t = np.linspace(0.0, end, math.ceil(end / period) + 1)
    rising = 0.5 * acceleration * t**2
    falling = length - 0.5 * acceleration * (end - t) ** 2
    steady = speed * t - 0.5 * speed * ramp
    return t, np.where(t < ramp, rising, np.where(t < end - ramp, steady, falling))


def carry(start, direction, *, length, speed, acceleration, height=3.0):
    """Times and arm vectors of a straight carry of the palm's top."""
    times, along = ramped(length, speed, acceleration)
    vectors, near = [], None
    for s in along:
        vector = holding(np.asarray(start) + s * np.asarray(direction), height=height, near=near)
        near = vector[1:7]
        vectors.append(vector)
    return times, np.array(vectors)
