"""Splits collision meshes into convex parts, which then collide instead of the convex hull.

CoACD (Wei et al., SIGGRAPH 2022) does the work; it comes with the extra `meshes`.
"""

from __future__ import annotations

import functools
import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pips_drake.errors import InputError
from pips_drake.scene.meshes import TriangleMesh, convex_hull, hull_excess, read_obj

if TYPE_CHECKING:
    from pydrake.geometry import SceneGraph
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

#: Where parts keep what they are parts of, among their proximity properties: group and names.
GROUP, MESH, SCALE = "decomposition", "mesh", "scale"

#: Concavity that CoACD leaves in a part, m, unless that is finer than it can (part of the size).
CONCAVITY, FINEST = 2e-3, 0.03


def AddConvexParts(
    plant: MultibodyPlant, scene_graph: SceneGraph, models: Sequence[ModelInstanceIndex]
) -> None:
    """Replaces the models' collision meshes (*.obj) by convex parts; call it before Finalize.

    A mesh that is convex already stays, and so does one that the model declares convex.

    Raises:
        InputError: CoACD is not installed, or a mesh cannot be read.
    """
    from pydrake.geometry import Convex, Mesh, ProximityProperties, Role

    _require_library()
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for body in (plant.get_body(b) for model in models for b in plant.GetBodyIndices(model)):
        for geometry in plant.GetCollisionGeometriesForBody(body):
            shape = inspector.GetShape(geometry)
            if not isinstance(shape, Mesh) or shape.extension() != ".obj":
                continue
            file = shape.source().path()
            mesh = read_obj(file, shape.scale3())
            parts = decompose(mesh)
            if len(parts) < 2:
                continue
            name, X_BG = inspector.GetName(geometry), inspector.GetPoseInFrame(geometry)
            properties = ProximityProperties(inspector.GetProximityProperties(geometry))
            properties.AddProperty(GROUP, MESH, str(file))
            properties.AddProperty(GROUP, SCALE, " ".join(map(repr, shape.scale3().tolist())))
            scene_graph.RemoveRole(source, geometry, Role.kProximity)
            for number, part in enumerate(parts):
                plant.RegisterCollisionGeometry(
                    body,
                    X_BG,
                    Convex(part.vertices.T, f"part {number} of {Path(file).name}"),
                    f"{name.split('::')[-1]}_part_{number}",
                    ProximityProperties(properties),
                )


def decompose(mesh: TriangleMesh) -> tuple[TriangleMesh, ...]:
    """Convex hulls that together are about the mesh; the same mesh gives the same parts.

    Of a mesh that is convex already it is the hull alone, and of a flat one nothing.

    Raises:
        InputError: CoACD is not installed.
    """
    _require_library()
    return _decompose(mesh.vertices.tobytes(), mesh.triangles.tobytes())


@functools.lru_cache(maxsize=64)  # every diagram of a run needs the same parts
def _decompose(vertices: bytes, triangles: bytes) -> tuple[TriangleMesh, ...]:
    p = np.frombuffer(vertices).reshape(-1, 3)
    rows = np.frombuffer(triangles, dtype=np.int64).reshape(-1, 3)
    hull = convex_hull(p)
    if hull is None:
        return ()
    if hull_excess(hull, TriangleMesh(p, rows)) <= CONCAVITY:
        return (hull,)
    size = float(np.ptp(p, axis=0).max())
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/vertices.npy", p)
        np.save(f"{folder}/triangles.npy", rows)
        threshold = max(CONCAVITY / size, FINEST)
        # In a process of its own: where CoACD's library is loaded before Drake has read its first
        # SDF, Drake cannot read any (measured: CoACD 1.0.14, drake 1.58).
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT, folder, repr(threshold)],
            capture_output=True,
            check=False,
        )
        if done.returncode != 0:
            said = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise InputError(f"decompose_meshes: CoACD stopped ({said[-1]})")
        files = sorted(Path(folder).glob("part_*.npy"))
        hulls = [convex_hull(np.load(file)) for file in files]
    return tuple(hull for hull in hulls if hull is not None)


_SCRIPT = """
import sys
import coacd
import numpy as np
folder, threshold = sys.argv[1], float(sys.argv[2])
coacd.set_log_level("error")
mesh = coacd.Mesh(np.load(f"{folder}/vertices.npy"), np.load(f"{folder}/triangles.npy"))
for number, part in enumerate(coacd.run_coacd(mesh, threshold=threshold, seed=0)):
    np.save(f"{folder}/part_{number:04d}.npy", part[0])
"""


def _require_library() -> None:
    if importlib.util.find_spec("coacd") is None:
        raise InputError(
            "decompose_meshes: CoACD is missing; install it with the extra `meshes` "
            "(pip install 'pips-drake[meshes]')"
        )
