"""A scene's body that stands elsewhere: the pose it gets, and which bodies may be displaced."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.loading import AddPlacedFrame, AddScene
from pips_drake.scene.packages import find_scene_file
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.station.faults import displace_bodies

OFFSET_MM = [100.0, -200.0, 300.0]


@pytest.fixture
def standing():
    """A plant with trajectory 4's scene on the pad, not final, and the scene's models."""
    plant = MultibodyPlant(0.0)
    X_WF = RigidTransform(RotationMatrix(mounting_rotation("pad")), [0.5, 0.0, 3.0])
    AddPlacedFrame(plant, "frame_0", X_WF)
    return plant, AddScene(plant, find_scene_file("trajectory_4"), base_frame="frame_0")


def fault(body: str) -> FaultConfig:
    return FaultConfig(kind="payload_displaced", body=body, offset_mm=OFFSET_MM)


def places(plant, models) -> dict:
    plant.Finalize()
    context = plant.CreateDefaultContext()
    bodies = [plant.get_body(i) for model in models for i in plant.GetBodyIndices(model)]
    return {
        str(body.scoped_name()): plant.EvalBodyPoseInWorld(context, body).GetAsMatrix34()
        for body in bodies
    }


def test_one_body_is_displaced_in_frame_0_and_the_others_stand(standing):
    plant, models = standing
    displace_bodies(plant, models, [fault("payload::payload"), FaultConfig(kind="late")])
    there = places(plant, models)
    plant = MultibodyPlant(0.0)
    X_WF = RigidTransform(RotationMatrix(mounting_rotation("pad")), [0.5, 0.0, 3.0])
    AddPlacedFrame(plant, "frame_0", X_WF)
    here = places(plant, AddScene(plant, find_scene_file("trajectory_4"), base_frame="frame_0"))
    assert list(there) == list(here) and len(here) > 1
    # On the pad x0 points down and z0 along x (`mounting`), so this is OFFSET_MM in the world.
    moved = {"payload::payload": [0.3, -0.2, -0.1]}
    for name, X in here.items():
        expected = X.copy()
        expected[:, 3] += moved.get(name, 0.0)
        # A few roundings of positions of meters.
        np.testing.assert_allclose(there[name], expected, rtol=0, atol=1e-14)


def test_an_unknown_body_names_the_known_ones(standing):
    with pytest.raises(UnknownNameError, match="payload::payload"):
        displace_bodies(*standing, [fault("crate::crate")])


def test_a_body_that_is_not_welded_cannot_be_displaced():
    plant = MultibodyPlant(0.0)
    model = plant.AddModelInstance("crate")
    plant.AddRigidBody("crate", model, SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    with pytest.raises(InputError, match=r"'crate::crate'.* is loose; must be welded"):
        displace_bodies(plant, [model], [fault("crate::crate")])
