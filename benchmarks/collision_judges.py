"""Two judges of whether a recorded motion collides; neither is the twin's own clearance monitor.

`DrakeJudge` asks Drake's yes/no query (`HasCollisions`) in a plant of its own. `CoalJudge` asks
another library, coal, with shapes built anew from the scene graph's own numbers, and with every
pair of shapes that the scene graph does not leave out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake import geometry
from pydrake.geometry import SceneGraphInspector

from pips_drake.serpentine.runs.placed_arm import PlacedArm

Array = NDArray[np.float64]

#: Two libraries may call the same pair touching and clear where it is this near to touching, m:
#: 0.1 mm, what the twin's own proof leaves open. Their iterations end at about 1e-6 m.
TOUCHING = 1e-4


class DrakeJudge:
    """Drake's yes or no.

    Args:
        placed: arm and scene, as they really stand.
    """

    def __init__(self, placed: PlacedArm) -> None:
        self._placed = placed
        self._root = placed.diagram.CreateDefaultContext()
        self._plant = placed.plant.GetMyMutableContextFromRoot(self._root)
        self._scene_graph = placed.scene_graph.GetMyContextFromRoot(self._root)

    def query(self, positions: Array) -> Any:
        """The scene graph's query object at a posture of the arm, (nq,)."""
        self._placed.plant.SetPositions(self._plant, self._placed.model, positions)
        return self._placed.scene_graph.get_query_output_port().Eval(self._scene_graph)

    def collides(self, positions: Array) -> bool:
        """Whether anything touches at a posture."""
        return bool(self.query(positions).HasCollisions())

    def collisions(self, postures: Array) -> NDArray[np.int64]:
        """The rows of (N, nq) in which anything touches."""
        return np.flatnonzero([self.collides(row) for row in postures])


class CoalJudge:
    """Coal's least signed distance.

    Args:
        drake: poses the shapes, so that both judges look at the same places.
        inspector: of the same scene graph.
    """

    def __init__(self, drake: DrakeJudge, inspector: SceneGraphInspector) -> None:
        import coal

        self._drake, self._coal = drake, coal
        pairs = sorted(inspector.GetCollisionCandidates(), key=str)
        self._ids = sorted({one for pair in pairs for one in pair}, key=str)
        row = {one: k for k, one in enumerate(self._ids)}
        self._pairs = np.array([[row[first], row[second]] for first, second in pairs])
        self._names = [inspector.GetName(one) for one in self._ids]
        self._shapes = [
            _coal_shape(coal, inspector.GetShape(one), lambda one=one: _hull(inspector, one))
            for one in self._ids
        ]
        for shape in self._shapes:
            shape.computeLocalAABB()
        self._radii = np.array([shape.aabb_radius for shape in self._shapes])
        self._centres = np.array([shape.aabb_center for shape in self._shapes])
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True  # else whatever penetrates is 0 apart

    def least(self, positions: Array, reach: float = 0.05) -> tuple[float, tuple[str, str] | None]:
        """The least distance at a posture, m, negative in penetration; and of which shapes.

        Args:
            reach: what is farther apart is not looked at; the distance then is `reach`, m.
        """
        query = self._drake.query(positions)
        poses = [query.GetPoseInWorld(one) for one in self._ids]
        rotations = [pose.rotation().matrix() for pose in poses]
        places = np.array([pose.translation() for pose in poses])
        centres = places + np.einsum("nij,nj->ni", np.array(rotations), self._centres)
        first, second = self._pairs.T
        gap = np.linalg.norm(centres[first] - centres[second], axis=1)
        near = self._pairs[gap - self._radii[first] - self._radii[second] < reach]
        moved = [
            self._coal.Transform3s(rotation, place)
            for rotation, place in zip(rotations, places, strict=True)
        ]
        least, pair = reach, None
        for a, b in near.tolist():
            result = self._coal.DistanceResult()
            distance = self._coal.distance(
                self._shapes[a], moved[a], self._shapes[b], moved[b], self._request, result
            )
            if distance < least:
                least, pair = float(distance), (self._names[a], self._names[b])
        return least, pair


def disagreements(
    drake: DrakeJudge, coal: CoalJudge, postures: Array, rows: Iterable[int]
) -> list[str]:
    """Where one judge sees a collision and the other does not, a sentence each.

    Args:
        postures: (N, nq).
        rows: of the postures, to be looked at.
    """
    found = []
    for row in rows:
        touches, (least, pair) = drake.collides(postures[row]), coal.least(postures[row])
        if (touches and least > TOUCHING) or (not touches and least < -TOUCHING):
            word = "touching" if touches else "clear"
            found.append(f"step {row}: Drake says {word}, coal {least * 1e3:.3f} mm, {pair}")
    return found


def _coal_shape(coal: Any, shape: geometry.Shape, hull: Callable[[], Array]) -> Any:
    """The same shape in coal; meshes are their convex hulls, as Drake has them."""
    match shape:
        case geometry.Box():
            return coal.Box(*shape.size())
        case geometry.Sphere():
            return coal.Sphere(shape.radius())
        case geometry.Cylinder():
            return coal.Cylinder(shape.radius(), shape.length())
        case geometry.Capsule():
            return coal.Capsule(shape.radius(), shape.length())
        case geometry.Convex() | geometry.Mesh():
            return _coal_hull(coal, hull())
    raise TypeError(f"no {type(shape).__name__} in coal")


def _hull(inspector: SceneGraphInspector, one: geometry.GeometryId) -> Array:
    """Corners of the hull that Drake computes for a mesh, (N, 3) m."""
    hull = inspector.GetConvexHull(one)
    return np.array([hull.vertex(k) for k in range(hull.num_vertices())])


def _coal_hull(coal: Any, corners: Array) -> Any:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    points = coal.StdVec_Vec3s()
    for point in corners:
        points.append(point)
    triangles = coal.StdVec_Triangle()
    for face, plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        a, b, c = face
        outward = np.cross(corners[b] - corners[a], corners[c] - corners[a]) @ plane[:3] > 0.0
        triangles.append(coal.Triangle(a, b, c) if outward else coal.Triangle(a, c, b))
    return coal.Convex(points, triangles)
