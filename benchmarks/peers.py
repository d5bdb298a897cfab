"""What others would solve the arm's posture with: Drake's InverseKinematics, and pinocchio.

Both are given the spine points for free (ours are where follow-the-leader found them) and start at
the posture of the tip position before, which is nearer than anything a user has at first. Neither
does the part of the work that places spine points on the path.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.units import INCH

Array = NDArray[np.float64]

#: Spine error at which the peers may stop, m: 1e-9 in, as ours.
TOLERANCE = 1e-9 * INCH
#: Gauss-Newton converges quadratically: 2 or 3 iterations are typical.
MAX_ITERATIONS = 20


class DrakeInverse:
    """Drake's InverseKinematics with SNOPT: built once, bounds and guess renewed for each posture.

    Eight position constraints are 24 equations for 17 unknowns (no spine point needs the last
    joint). They agree, but SNOPT's line search stalls on such a system at 1e-6 in. So of each point
    after the first, the coordinate along which its module mostly points is left free: the module's
    length fixes it. That, with a function precision near the machine's and tight feasibility
    tolerances, is the best of what was tried: nearly everywhere it gets below 1e-9 in, at one or
    two points in a hundred it stalls at 1e-8 in. Others: all 24 equations (as fast where it
    converges, stalls on a tenth of the points), bounds of the tolerance's size instead of equations
    (stalls), and IPOPT (twenty times slower).
    """

    def __init__(self, arm: SerpentineArm) -> None:
        from pydrake.math import RigidTransform
        from pydrake.multibody.inverse_kinematics import InverseKinematics
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.solvers import SnoptSolver, SolverOptions

        from pips_drake.serpentine.station import AddSerpentineArm

        plant = MultibodyPlant(0.0)
        AddSerpentineArm(plant, arm, RigidTransform())
        plant.Finalize()
        self._plant = plant  # the program only refers to it
        # Without joint limits: none is active, and the program is smaller.
        self._problem = InverseKinematics(plant, with_joint_limits=False)
        zero = np.zeros(3)
        self._constraints = [
            self._problem.AddPositionConstraint(
                plant.GetBodyByName(arm.bodies[j - 1].name).body_frame(),
                zero,
                plant.world_frame(),
                zero,
                zero,
            ).evaluator()
            for j in arm.spine_indices
        ]
        last = self._problem.q()[arm.joints - 1]
        self._problem.prog().AddBoundingBoxConstraint(0.0, 0.0, last)
        self._solver = SnoptSolver()
        self._options = SolverOptions()
        for option, value in (
            ("Major feasibility tolerance", 1e-12),
            ("Minor feasibility tolerance", 1e-13),
            ("Function precision", 1e-15),
        ):
            self._options.SetOption(self._solver.id(), option, value)

    def solve(self, start: Array, spine: Array) -> Array:
        """Joints (J,) that put the spine points (M + 1, 3) m there, from `start` (J,)."""
        for k, constraint in enumerate(self._constraints):
            lower, upper = spine[k].copy(), spine[k].copy()
            if k:
                along = np.argmax(np.abs(spine[k] - spine[k - 1]))
                lower[along], upper[along] = -np.inf, np.inf
            constraint.set_bounds(lower, upper)
        result = self._solver.Solve(self._problem.prog(), start, self._options)
        joints: Array = result.GetSolution(self._problem.q())
        return joints


class PinocchioInverse:
    """Damped Gauss-Newton over the spine points' errors with pinocchio's Jacobians.

    A loop in Python around pinocchio's C++, as its own example of inverse kinematics is. Attribute
    `in_pinocchio` says what share of the time its C++ calls have.
    """

    def __init__(self, arm: SerpentineArm) -> None:
        import pinocchio

        self._pin = pinocchio
        self._model = make_pinocchio_model(arm)
        self._data = self._model.createData()
        self._frames = [int(j) for j in arm.spine_indices]
        self._aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self._free = arm.joints - 1  # no spine point needs the last joint
        self._damping = 1e-12 * np.eye(self._free)
        self.iterations = 0

    def solve(self, start: Array, spine: Array) -> Array:
        """Joints (J,) that put the spine points (M + 1, 3) m there, from `start` (J,)."""
        pin, model, data, free = self._pin, self._model, self._data, self._free
        joints = start.copy()
        for _ in range(MAX_ITERATIONS):
            pin.computeJointJacobians(model, data, joints)  # forward kinematics along with it
            reached = np.array([data.oMi[j].translation for j in self._frames])
            error = spine - reached
            if (error * error).sum(axis=1).max() <= TOLERANCE**2:
                break
            self.iterations += 1
            jacobian = np.concatenate(
                [
                    pin.getJointJacobian(model, data, j, self._aligned)[:3, :free]
                    for j in self._frames
                ]
            )
            normal = jacobian.T @ jacobian + self._damping
            joints[:free] += np.linalg.solve(normal, jacobian.T @ error.ravel())
        return joints

    def calls_alone(self, joints: Array) -> None:
        """One iteration's calls of pinocchio and nothing else, to see what they cost."""
        self._pin.computeJointJacobians(self._model, self._data, joints)
        for j in self._frames:
            self._pin.getJointJacobian(self._model, self._data, j, self._aligned)


def make_pinocchio_model(arm: SerpentineArm) -> object:
    """The arm's joints as a pinocchio model, from its DH table (Craig's: FTL-95 Table A.1)."""
    import pinocchio

    model = pinocchio.Model()
    parent = 0
    for j, (alpha, a, d, theta, _) in enumerate(arm.dh_table):
        tilt = pinocchio.SE3(_rotation(0, alpha), np.array([a, 0.0, 0.0]))
        turn = pinocchio.SE3(_rotation(2, theta), np.array([0.0, 0.0, d]))
        slides = arm.is_prismatic[j]
        kind = pinocchio.JointModelPZ() if slides else pinocchio.JointModelRZ()
        parent = model.addJoint(parent, kind, tilt * turn, arm.joint_names[j])
    return model


def _rotation(axis: int, angle: float) -> Array:
    """Rotation matrix about a coordinate axis."""
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.roll(matrix, axis, axis=(0, 1))
