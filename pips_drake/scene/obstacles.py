"""Obstacles from a file: as shapes of a distance field, and as a scene that a plant collides with.

One list makes both, so that what a planner avoids is what the twin can hit. As a scene they are a
folder's three files: `obstacles.sdf` has the shapes, `scene.dmd.yaml` says where they stand and
what other scene stands there too, and `package.xml` lets the second name the first wherever the
folder lies.
"""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from pips_drake.config import load_yaml, require
from pips_drake.errors import InputError
from pips_drake.scene.loading import DIRECTIVES
from pips_drake.scene.packages import list_names, models_directory
from pips_drake.scene.signed_distance import PlacedShape

if TYPE_CHECKING:
    from pydrake.geometry import Shape

#: Their model in a plant; a body is called `placed_obstacles::NAME`.
MODEL = "placed_obstacles"
#: Files of a scene of obstacles.
SCENE_FILE, SDF_FILE, PACKAGE_FILE = f"scene{DIRECTIVES}", "obstacles.sdf", "package.xml"
#: What `size_m` of a kind holds.
SIZES = {
    "box": "along x, y and z",
    "sphere": "diameter",
    "cylinder": "diameter, length",
    "capsule": "diameter, length between its caps",
}
#: Smallest and largest measure of an obstacle, m.
SMALLEST, LARGEST = 1e-3, 1e3
# Red, green, blue, and opacity of obstacles.
_COLOR = "0.835 0.369 0.0 1"


@dataclass
class ObstacleConfig:
    """One obstacle."""

    # Letters, digits and underscores.
    name: str = ""
    # box, sphere, cylinder or capsule; the last two along their own z axis.
    kind: str = "box"
    # In m; box: along x, y and z; sphere: diameter; cylinder: diameter, length; capsule: diameter,
    # length between its caps.
    size_m: list[float] = field(default_factory=list)
    # Of its middle, in frame 0.
    position_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Roll, pitch and yaw in frame 0: about x, then y, then z, which stay.
    rpy_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def validate(self) -> None:
        good = re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", self.name) is not None
        require(good, "name", repr(self.name), "a letter, then letters, digits and underscores")
        require(self.kind in SIZES, f"{self.name}.kind", self.kind, " or ".join(SIZES))
        what = SIZES[self.kind]
        good = len(self.size_m) == {"box": 3, "sphere": 1}.get(self.kind, 2)
        require(good, f"{self.name}.size_m", self.size_m, f"of a {self.kind}: {what}")
        for size in self.size_m:
            good = SMALLEST <= size <= LARGEST
            require(good, f"{self.name}.size_m", f"{size} m", f"{SMALLEST:g} .. {LARGEST:g} m")
        for name in ("position_m", "rpy_deg"):
            value = getattr(self, name)
            require(len(value) == 3, f"{self.name}.{name}", value, "three numbers")


@dataclass
class ObstaclesConfig:
    """A file of obstacles."""

    obstacles: list[ObstacleConfig] = field(default_factory=list)

    def validate(self) -> None:
        names = [obstacle.name for obstacle in self.obstacles]
        twice = next((name for name in names if names.count(name) > 1), "")
        require(not twice, "obstacles: name", f"{twice} (twice)", "different from the others'")


def load_obstacles(file: Path) -> list[ObstacleConfig]:
    """The obstacles of a YAML file.

    Raises:
        InputError: it cannot be read, a name stands in it twice, a measure is not positive, or a
            number is not finite.
    """
    return load_yaml(ObstaclesConfig, file).obstacles


def placed_shape(obstacle: ObstacleConfig) -> PlacedShape:
    """The obstacle as a shape of a field in frame 0, with the name that its body has in a plant."""
    from pydrake.math import RigidTransform, RollPitchYaw

    return PlacedShape(
        body=f"{MODEL}::{obstacle.name}",
        name=obstacle.name,
        shape=_shape(obstacle),
        X_WG=RigidTransform(
            RollPitchYaw([math.radians(angle) for angle in obstacle.rpy_deg]), obstacle.position_m
        ),
    )


def write_scene(folder: Path, scene: str, obstacles: list[ObstacleConfig]) -> Path:
    """Writes a scene and obstacles in it as a scene file that `AddScene` takes.

    The folder may be moved, unless the scene is a file of one's own: that is named by its path.

    Args:
        folder: where the files go; it exists.
        scene: a shipped scene's name, the path of a `*.dmd.yaml`, or empty for none.
        obstacles: with different names.

    Returns:
        `SCENE_FILE` in the folder.

    Raises:
        InputError: the scene is a file of another kind, which does not say where it stands.
    """
    directives = []
    if scene:
        directives.append(f"- add_directives:\n    file: {_uri(scene)}\n")
    if obstacles:
        directives.append(
            f"- add_model:\n    name: {MODEL}\n    file: package://{MODEL}/{SDF_FILE}\n"
        )
    for obstacle in obstacles:
        position = ", ".join(repr(float(value)) for value in obstacle.position_m)
        angles = ", ".join(repr(float(value)) for value in obstacle.rpy_deg)
        directives.append(
            f"- add_weld:\n    parent: frame_0\n    child: {MODEL}::{obstacle.name}\n"
            f"    X_PC:\n      translation: [{position}]\n"
            f"      rotation: !Rpy {{deg: [{angles}]}}\n"
        )
    links = "".join(_link(obstacle) for obstacle in obstacles)
    texts = {
        PACKAGE_FILE: f'<?xml version="1.0"?>\n<package format="2">\n  <name>{MODEL}</name>\n'
        "</package>\n",
        SDF_FILE: '<?xml version="1.0"?>\n<!-- Obstacles; scene.dmd.yaml says where. -->\n'
        f'<sdf version="1.9">\n  <model name="{MODEL}">\n{links}  </model>\n</sdf>\n',
        SCENE_FILE: "# A scene with obstacles placed in it; poses are in frame_0.\ndirectives:\n"
        + "".join(directives),
    }
    for name, text in texts.items():
        if name != SDF_FILE or obstacles:  # a model without links is refused
            (folder / name).write_text(text, encoding="utf-8")
    return folder / SCENE_FILE


def _uri(scene: str) -> str:
    if scene in list_names("scene"):
        return f"package://pips_drake/scenes/{scene}{DIRECTIVES}"
    if not scene.endswith(DIRECTIVES):
        raise InputError(
            f"scene {scene}: obstacles cannot be placed in it; must be a shipped scene or a "
            f"*{DIRECTIVES}"
        )
    file = Path(scene).resolve()
    if file.is_relative_to(models_directory().resolve()):
        return f"package://pips_drake/{file.relative_to(models_directory().resolve()).as_posix()}"
    if not file.is_file():
        raise InputError(f"scene {scene}: no such file")
    if (file.parent / PACKAGE_FILE).is_file():
        raise InputError(
            f"scene {scene}: obstacles cannot be placed in it; must not name files of a package "
            "of its own, as a scene with obstacles does"
        )
    return file.as_uri()


def _shape(obstacle: ObstacleConfig) -> "Shape":
    from pydrake.geometry import Box, Capsule, Cylinder, Sphere

    size = obstacle.size_m
    if obstacle.kind == "box":
        return Box(*size)
    if obstacle.kind == "sphere":
        return Sphere(0.5 * size[0])
    return (Cylinder if obstacle.kind == "cylinder" else Capsule)(0.5 * size[0], size[1])


def _link(obstacle: ObstacleConfig) -> str:
    """An SDF link with its shape at its origin: where that stands is said in one place only."""
    size = [repr(float(value)) for value in obstacle.size_m]
    if obstacle.kind == "box":
        inner = f"<size>{' '.join(size)}</size>"
    else:
        inner = f"<radius>{0.5 * obstacle.size_m[0]!r}</radius>"
        inner += f"<length>{size[1]}</length>" if obstacle.kind != "sphere" else ""
    geometry = f"<geometry><{obstacle.kind}>{inner}</{obstacle.kind}></geometry>"
    return (
        f'    <link name="{obstacle.name}">\n'
        f'      <visual name="{obstacle.name}_visual">\n        {geometry}\n'
        f"        <material><diffuse>{_COLOR}</diffuse></material>\n      </visual>\n"
        f'      <collision name="{obstacle.name}">\n        {geometry}\n      </collision>\n'
        "    </link>\n"
    )
