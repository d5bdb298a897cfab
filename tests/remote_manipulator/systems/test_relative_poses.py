"""What the program measures: poses in the orbiter's frame, wherever the orbiter is."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.station.plant import PlantSettings, home_arm_vector, make_plant
from pips_drake.remote_manipulator.systems.relative_poses import RelativePoses

CONFIG = load_configuration()


class Measured:
    def __init__(self):
        builder = DiagramBuilder()
        self.machine = machine = make_plant(
            builder, CONFIG, PlantSettings(support="none", orbiter_translates=True)
        )
        self.poses = builder.AddSystem(
            RelativePoses(
                orbiter_index=machine.orbiter.index(),
                payload_index=machine.payload_body.index(),
                cae_index=machine.cae.index(),
            )
        )
        plant = machine.plant
        builder.Connect(plant.get_body_poses_output_port(), self.poses.GetInputPort("body_poses"))
        builder.Connect(
            plant.get_state_output_port(machine.arm), self.poses.GetInputPort("arm_state")
        )
        self.root = builder.Build().CreateDefaultContext()
        self.context = plant.GetMyMutableContextFromRoot(self.root)
        machine.set_initial_state(self.context)

    def read(self, name):
        return self.poses.GetOutputPort(name).Eval(self.poses.GetMyContextFromRoot(self.root))


@pytest.fixture(scope="module")
def measured():
    return Measured()


def test_at_first_they_are_the_configurations(measured):
    measured.machine.set_initial_state(measured.context)
    cae = CONFIG.central_assembly_element.location_m
    one = [1.0, 0.0, 0.0, 0.0]
    place = CONFIG.payload.location_m
    np.testing.assert_allclose(measured.read("payload_pose"), [*one, *place], atol=1e-12)
    np.testing.assert_allclose(measured.read("cae_pose"), [*one, *cae], atol=1e-12)
    np.testing.assert_allclose(measured.read("arm_measured"), home_arm_vector(CONFIG), atol=1e-12)


def test_payload_is_seen_turned_with_a_positive_first_component(measured):
    machine = measured.machine
    for rpy in ((0.1, -0.2, 3.0), (-3.0, 0.4, -2.0), (0.0, 0.0, np.pi)):
        X_RP = RigidTransform(RollPitchYaw(*rpy), [3.0, -1.0, 2.0])
        machine.place_payload(measured.context, X_RP)
        pose = measured.read("payload_pose")
        assert pose[0] >= 0.0
        turned = Rotation.from_quat(pose[:4], scalar_first=True).as_matrix()
        np.testing.assert_allclose(turned, X_RP.rotation().matrix(), atol=1e-12)
        np.testing.assert_allclose(pose[4:], [3.0, -1.0, 2.0], atol=1e-12)


def test_translating_the_orbiter_moves_the_cae_the_other_way(measured):
    machine, offset = measured.machine, np.array([0.3, -0.2, 0.1])
    machine.set_initial_state(measured.context)
    payload, cae = measured.read("payload_pose").copy(), measured.read("cae_pose").copy()
    machine.plant.SetPositions(measured.context, machine.orbiter_motion, offset)
    np.testing.assert_allclose(measured.read("cae_pose")[4:], cae[4:] - offset, atol=1e-12)
    np.testing.assert_allclose(measured.read("payload_pose")[4:], payload[4:] - offset, atol=1e-12)
