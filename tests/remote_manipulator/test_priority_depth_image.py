"""The painter's order beside the depth pictures of the modelled machine, rendered by Drake."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from pips_drake.remote_manipulator.clusters import machine_pose
from pips_drake.remote_manipulator.phases import PHASES
from pips_drake.remote_manipulator.station.plant import X_WR, PlantSettings, make_plant
from pips_drake.twin.rendering import add_renderer, render_available, render_depth

from .priority_scenes import (
    CONFIG,
    MODEL,
    NAMES,
    depths,
    eye_and_look,
    random_state,
)

SIZE = (64, 48)
FIELD_OF_VIEW = math.radians(60.0)
# A prism's edge stands out of its cylinder by 16 mm, more where a ray grazes it; only pixels whose
# depth is that of one cluster within this, and of no other within ten times this, are looked at.
NEAR = 0.03
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(render_available() is not None, reason=str(render_available())),
]


def pixel_rays(look: np.ndarray) -> np.ndarray:
    """Rays through the pixels of a picture of `SIZE`, row by row; 1 m ahead, as depths are."""
    width, height = SIZE
    focal = 0.5 * height / math.tan(0.5 * FIELD_OF_VIEW)
    right = (np.arange(width) - 0.5 * (width - 1)) / focal
    down = (np.arange(height) - 0.5 * (height - 1)) / focal
    z, y = np.meshgrid(down, right, indexing="ij")
    result: np.ndarray = np.column_stack([np.ones(z.size), y.ravel(), z.ravel()]) @ look.T
    return result


@pytest.fixture(scope="module")
def machine():
    builder = DiagramBuilder()
    made = make_plant(builder, CONFIG, PlantSettings(support="none"))
    add_renderer(made.scene_graph)
    diagram = builder.Build()
    return made, diagram, diagram.CreateDefaultContext()


@pytest.mark.parametrize("phase", PHASES)
def test_what_is_rendered_is_not_painted_over_by_what_is_claimed_to_be_behind(machine, phase):
    made, _, root = machine
    context = made.plant.GetMyContextFromRoot(root)
    graph = made.scene_graph
    rng = np.random.default_rng(20)
    known = behind = 0
    for _ in range(4):
        arm_vector, payload = random_state(phase, rng)
        pose = machine_pose(CONFIG, arm_vector, payload)
        made.plant.SetPositions(context, made.arm, made.positions_from_arm_vector(arm_vector))
        made.place_payload(context, RigidTransform(RotationMatrix(pose.R_RP), pose.p_RP))
        query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(root))
        for station in CONFIG.cameras.stations:
            eye, look = eye_and_look(station, pose)
            axes = RotationMatrix(look[:, [1, 2, 0]])
            X_WC = X_WR.multiply(RigidTransform(axes, eye))
            image = render_depth(query, X_WC, size=SIZE, field_of_view=FIELD_OF_VIEW).ravel()
            priority = MODEL.order(pose, eye, phase=phase, station=station.name)
            (found,) = depths(pose, [eye], [pixel_rays(look)])
            enter = found[0][[NAMES.index(name) for name in priority.order]]
            off = np.where(np.isfinite(enter), np.abs(enter - image), np.inf)
            clear = np.sum(off < 10.0 * NEAR, axis=0) == 1
            pixels = np.flatnonzero(clear & (np.min(off, axis=0) < NEAR))
            seen = np.argmin(off[:, pixels], axis=0)
            known += len(pixels)
            for pixel, cluster in zip(pixels, seen, strict=True):
                # It is drawn, so what the ray meets besides is behind it, and must not be claimed
                # to be before it.
                over = np.isfinite(enter[:cluster, pixel])
                wrong = over & priority.claims[:cluster, cluster]
                wrong &= enter[:cluster, pixel] > image[pixel]
                assert not np.any(wrong), (station.name, priority.order[cluster])
                behind += int(np.sum(np.isfinite(enter[cluster + 1 :, pixel])))
    # Enough is told apart, and much of it hides something.
    print(f"{phase}: {known} pixels, {behind} clusters behind what they show")
    assert known > 10_000
    assert behind > 3_000
