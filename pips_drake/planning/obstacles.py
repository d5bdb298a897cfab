"""Obstacles placed in a scene, moved and removed while a planner runs.

Nothing changes: each step makes another set, whose field shares all shapes but the changed one with
the last, so that `Occupancy.updated` looks again only at the cells around what changed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pips_drake.config import validate
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.obstacles import ObstacleConfig, placed_shape, write_scene
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField


@dataclass(frozen=True, eq=False)
class Obstacles:
    """A scene's field and the obstacles placed in it.

    Attributes:
        scene: the field without them.
        configs: one an obstacle, in the order in which they were placed.
        shapes: the same in frame 0.
    """

    scene: SignedDistanceField
    configs: tuple[ObstacleConfig, ...] = ()
    shapes: tuple[PlacedShape, ...] = ()

    @staticmethod
    def of(scene: SignedDistanceField, configs: Iterable[ObstacleConfig]) -> Obstacles:
        """A scene with obstacles, from `load_obstacles` for example.

        Raises:
            InputError: as `placed`.
        """
        obstacles = Obstacles(scene)
        for config in configs:
            obstacles = obstacles.placed(config)
        return obstacles

    @cached_property
    def field(self) -> SignedDistanceField:
        """The scene with the obstacles in it."""
        return self.scene.with_shapes(self.shapes) if self.shapes else self.scene

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(config.name for config in self.configs)

    def placed(self, config: ObstacleConfig) -> Obstacles:
        """With one more obstacle.

        Raises:
            InputError: its name is taken, a measure is not positive, or a number is not finite.
        """
        validate(config)
        if config.name in self.names:
            raise InputError(
                f"obstacle '{config.name}' is there already; must be moved or removed, or another "
                "name"
            )
        shape = placed_shape(config)
        return Obstacles(self.scene, (*self.configs, config), (*self.shapes, shape))

    def moved(
        self, name: str, position_m: Sequence[float], rpy_deg: Sequence[float] | None = None
    ) -> Obstacles:
        """With an obstacle at another place.

        Args:
            position_m: of its middle in frame 0, (3,) m.
            rpy_deg: roll, pitch and yaw in frame 0, (3,) deg; as they are by default.

        Raises:
            UnknownNameError: there is no such obstacle.
            InputError: not three finite numbers each.
        """
        k = self._index(name)
        config = dataclasses.replace(
            self.configs[k],
            position_m=[float(value) for value in position_m],
            rpy_deg=[float(v) for v in (self.configs[k].rpy_deg if rpy_deg is None else rpy_deg)],
        )
        validate(config)
        configs, shapes = list(self.configs), list(self.shapes)
        configs[k], shapes[k] = config, placed_shape(config)
        return Obstacles(self.scene, tuple(configs), tuple(shapes))

    def removed(self, name: str) -> Obstacles:
        """Without an obstacle.

        Raises:
            UnknownNameError: there is no such obstacle.
        """
        k = self._index(name)
        return Obstacles(
            self.scene,
            self.configs[:k] + self.configs[k + 1 :],
            self.shapes[:k] + self.shapes[k + 1 :],
        )

    def write_scene(self, folder: Path, scene: str) -> Path:
        """Writes them with their scene as a scene file, for the plant to collide with.

        Args:
            folder: where the files go; it exists.
            scene: what `scene` was read from: a shipped name, a `*.dmd.yaml`, or empty for none.

        Returns:
            The scene file.

        Raises:
            InputError: the scene is a file of another kind.
        """
        return write_scene(folder, scene, list(self.configs))

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise UnknownNameError("obstacle", name, self.names)
        return self.names.index(name)
