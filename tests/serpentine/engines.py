"""The exported arm in three engines that answer alike: Drake, pinocchio and MuJoCo.

All three stand with frame {0} in the place of the world, know 9.81 m/s^2 along -Z, and name bodies
and joints in the order of the arm. Drake reads SDF, pinocchio URDF, MuJoCo MJCF. The last two come
with the extra `peers` and are imported where they are used.
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from pips_drake.serpentine.mjcf import make_mjcf
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.urdf import make_urdf


class Drake:
    """The twin's plant, from the SDF."""

    def __init__(self, arm):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        Parser(self.plant).AddModelsFromString(make_sdf(arm), "sdf")
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("rail"))
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.bodies = [self.plant.GetBodyByName(body.name) for body in arm.bodies]

    def go(self, q, v):
        self.plant.SetPositions(self.plant_context, q)
        self.plant.SetVelocities(self.plant_context, v)

    def poses(self):
        found = [self.plant.EvalBodyPoseInWorld(self.plant_context, body) for body in self.bodies]
        return np.array([pose.GetAsMatrix4() for pose in found])

    def inertias(self):
        """Masses kg, centres m in the world, inertias about them in the world's axes kg m^2."""
        masses, centres, tensors = [], [], []
        for body in self.bodies:
            X_WB = self.plant.EvalBodyPoseInWorld(self.plant_context, body)
            inertia = body.CalcSpatialInertiaInBodyFrame(self.plant_context)
            centre = inertia.get_com()
            about = inertia.Shift(centre).ReExpress(X_WB.rotation())
            masses.append(inertia.get_mass())
            centres.append(X_WB @ centre)
            tensors.append(about.CalcRotationalInertia().CopyToFullMatrix3())
        return np.array(masses), np.array(centres), np.array(tensors)

    def mass_matrix(self):
        return self.plant.CalcMassMatrix(self.plant_context)

    def gravity(self):
        """What gravity does to the joints, N and Nm."""
        return self.plant.CalcGravityGeneralizedForces(self.plant_context)

    def bias(self):
        """Efforts that Coriolis and centrifugal forces and gravity ask for, N and Nm."""
        return self.plant.CalcBiasTerm(self.plant_context) - self.gravity()

    def tip_jacobian(self):
        world = self.plant.world_frame()
        return self.plant.CalcJacobianSpatialVelocity(
            self.plant_context,
            JacobianWrtVariable.kV,
            self.bodies[-1].body_frame(),
            np.zeros(3),
            world,
            world,
        )

    def solids(self):
        """Poses in the world of what collides, by body, in the file's order."""
        inspector = self.scene_graph.model_inspector()
        found = {}
        for body, X_WB in zip(self.bodies, self.poses(), strict=True):
            ids = self.plant.GetCollisionGeometriesForBody(body)
            shapes = [RigidTransform(inspector.GetPoseInFrame(i)).GetAsMatrix4() for i in ids]
            found[body.name()] = np.array([X_WB @ X_BG for X_BG in shapes])
        return found

    def limits(self):
        plant = self.plant
        efforts = [
            plant.get_joint_actuator(i).effort_limit() for i in plant.GetJointActuatorIndices()
        ]
        return plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits(), np.array(efforts)

    def touching(self, depth):
        """Pairs of bodies that go into each other by more than `depth`, m."""
        port = self.scene_graph.get_query_output_port()
        query = port.Eval(self.scene_graph.GetMyContextFromRoot(self.context))
        inspector = query.inspector()

        def name(geometry):
            return inspector.GetName(inspector.GetFrameId(geometry)).split("::")[-1]

        pairs = query.ComputeSignedDistancePairwiseClosestPoints(0.1)
        return {frozenset((name(p.id_A), name(p.id_B))) for p in pairs if p.distance < -depth}


class Pinocchio:
    """pinocchio's model, from the URDF."""

    def __init__(self, arm):
        import pinocchio

        self.pin = pinocchio
        text = make_urdf(arm)
        self.model = pinocchio.buildModelFromXML(text)
        self.geometry = pinocchio.buildGeomFromUrdfString(
            self.model, text, pinocchio.GeometryType.COLLISION
        )
        self.data = self.model.createData()
        assert list(self.model.names)[1:] == list(arm.joint_names)
        self.names = [body.name for body in arm.bodies]
        self.frames = [self.model.getFrameId(name) for name in self.names]

    def go(self, q, v):
        self.q, self.v = q, v
        self.pin.forwardKinematics(self.model, self.data, q, v)
        self.pin.updateFramePlacements(self.model, self.data)

    def poses(self):
        return np.array([self.data.oMf[frame].homogeneous for frame in self.frames])

    def inertias(self):
        masses, centres, tensors = [], [], []
        for joint in range(1, self.model.njoints):
            inertia, placement = self.model.inertias[joint], self.data.oMi[joint]
            masses.append(inertia.mass)
            centres.append(placement.act(inertia.lever))
            tensors.append(placement.rotation @ inertia.inertia @ placement.rotation.T)
        return np.array(masses), np.array(centres), np.array(tensors)

    def mass_matrix(self):
        upper = np.triu(self.pin.crba(self.model, self.data, self.q))
        return upper + np.triu(upper, 1).T

    def gravity(self):
        return -self.pin.computeGeneralizedGravity(self.model, self.data, self.q)

    def bias(self):
        return self.pin.nonLinearEffects(self.model, self.data, self.q, self.v)

    def tip_jacobian(self):
        world_aligned = self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self.pin.computeJointJacobians(self.model, self.data, self.q)
        jacobian = self.pin.getFrameJacobian(self.model, self.data, self.frames[-1], world_aligned)
        return np.vstack([jacobian[3:], jacobian[:3]])

    def solids(self):
        data = self.geometry.createData()
        self.pin.updateGeometryPlacements(self.model, self.data, self.geometry, data)
        found = {name: [] for name in self.names}
        for shape, placement in zip(self.geometry.geometryObjects, data.oMg, strict=True):
            name = self.model.frames[shape.parentFrame].name
            if name in found:  # the rail is the world's
                found[name].append(placement.homogeneous)
        return {name: np.array(poses) for name, poses in found.items()}

    def limits(self):
        model = self.model
        return model.lowerPositionLimit, model.upperPositionLimit, model.effortLimit


class Mujoco:
    """MuJoCo's model, from the MJCF."""

    def __init__(self, arm, mounting="laboratory"):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(make_mjcf(arm, mounting))
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(j).name for j in range(self.model.njnt)]
        assert joints == list(arm.joint_names)
        self.names = [body.name for body in arm.bodies]
        self.bodies = [self.model.body(name).id for name in self.names]

    def go(self, q, v):
        self.data.qpos[:], self.data.qvel[:] = q, v
        self.mujoco.mj_forward(self.model, self.data)

    def poses(self):
        result = np.tile(np.eye(4), (len(self.bodies), 1, 1))
        result[:, :3, :3] = self.data.xmat[self.bodies].reshape(-1, 3, 3)
        result[:, :3, 3] = self.data.xpos[self.bodies]
        return result

    def inertias(self):
        rotations = self.data.ximat[self.bodies].reshape(-1, 3, 3)
        principal = self.model.body_inertia[self.bodies]
        tensors = rotations * principal[:, None, :] @ rotations.transpose(0, 2, 1)
        masses = self.model.body_mass[self.bodies]
        return masses, self.data.xipos[self.bodies].copy(), tensors

    def mass_matrix(self):
        columns = []
        for unit in np.eye(self.model.nv):  # mj_fullM's arguments depend on the version
            column = np.zeros(self.model.nv)
            self.mujoco.mj_mulM(self.model, self.data, column, unit)
            columns.append(column)
        return np.array(columns).T

    def bias(self):
        return self.data.qfrc_bias.copy()

    def gravity(self):
        self.go(self.data.qpos.copy(), np.zeros(self.model.nv))
        return -self.bias()

    def tip_jacobian(self):
        linear, angular = np.zeros((2, 3, self.model.nv))
        tip = self.model.site("tip").id
        self.mujoco.mj_jacSite(self.model, self.data, linear, angular, tip)
        return np.vstack([angular, linear])

    def solids(self):
        found = {name: [] for name in self.names}
        for geom in range(self.model.ngeom):
            name = self.model.body(self.model.geom_bodyid[geom]).name
            if self.model.geom_contype[geom] and name in found:
                pose = np.eye(4)
                pose[:3, :3] = self.data.geom_xmat[geom].reshape(3, 3)
                pose[:3, 3] = self.data.geom_xpos[geom]
                found[name].append(pose)
        return {name: np.array(poses) for name, poses in found.items()}

    def limits(self):
        lower, upper = self.model.jnt_range.T
        assert np.all(self.model.jnt_limited)
        assert np.all(self.model.actuator_forcelimited)
        weakest, strongest = self.model.actuator_forcerange.T
        np.testing.assert_array_equal(weakest, -strongest)
        return lower, upper, strongest

    def run(self, seconds):
        """Goes on with the commands as they are."""
        for _ in range(round(seconds / self.model.opt.timestep)):
            self.mujoco.mj_step(self.model, self.data)

    def touching(self):
        """Pairs of bodies in contact, and how deep, m."""
        result = {}
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            names = [self.model.body(self.model.geom_bodyid[g]).name for g in contact.geom]
            pair = frozenset(names)
            result[pair] = max(result.get(pair, 0.0), -contact.dist)
        return result
