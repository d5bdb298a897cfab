"""Obstacles placed, moved and removed: the planner's are the plant's, and cells follow them."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.planning.grid import Grid
from pips_drake.planning.obstacles import Obstacles
from pips_drake.planning.occupancy import Occupancy
from pips_drake.scene.loading import AddPlacedFrame, AddScene, check_anchored
from pips_drake.scene.obstacles import ObstacleConfig, load_obstacles
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import SignedDistanceField, read_distance_field
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup

FILE = """
obstacles:
- {name: locker, kind: box, size_m: [0.3, 0.5, 0.8], position_m: [0.4, 0.3, 7.0],
   rpy_deg: [10.0, -35.0, 120.0]}
- {name: ball, kind: sphere, size_m: [0.25], position_m: [0.2, -0.6, 6.5]}
- {name: pole, kind: cylinder, size_m: [0.1, 2.0], position_m: [-0.4, 1.7, 8.0],
   rpy_deg: [0.0, 90.0, 17.3]}
- {name: pipe, kind: capsule, size_m: [0.12, 0.9], position_m: [-0.6, -1.7, 7.1],
   rpy_deg: [33.3, 0.0, 0.0]}
"""


@pytest.fixture
def configs(tmp_path):
    (tmp_path / "obstacles.yaml").write_text(FILE)
    return load_obstacles(tmp_path / "obstacles.yaml")


@pytest.fixture(scope="module")
def bay():
    return read_distance_field(find_scene_file("cargo_bay"))


def drakes_distances(file, points):
    """Of points to a scene file's shapes, by Drake: a tiny ball at each, in a plant of its own."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    AddPlacedFrame(plant, "frame_0", RigidTransform())
    models = AddScene(plant, file)
    plant.Finalize()
    check_anchored(plant, models, file)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    every = [query.ComputeSignedDistanceToPoint(p) for p in points]
    names = {
        inspector.GetName(inspector.GetFrameId(found.id_G)): inspector.GetShape(found.id_G)
        for found in every[0]
    }
    return np.array([min(found.distance for found in all_of) for all_of in every]), names


def test_the_plant_has_the_obstacles_that_the_planner_has(configs, bay, tmp_path):
    """Drake's distances in the written scene, the cargo bay with them, at points around them."""
    obstacles = Obstacles.of(bay, configs).moved("ball", [0.3, -0.5, 6.6], [5.0, 6.0, 7.0])
    folder = tmp_path / "plan"
    folder.mkdir()
    obstacles.write_scene(folder, "cargo_bay")
    # The files stay together, wherever that is.
    moved = tmp_path / "elsewhere"
    shutil.move(folder, moved)
    rng = np.random.default_rng(3)
    near = [np.array(c.position_m) + rng.normal(0.0, 0.2, (40, 3)) for c in obstacles.configs]
    points = np.concatenate(near)
    truth, names = drakes_distances(moved / "scene.dmd.yaml", points)
    assert {f"placed_obstacles::{c.name}" for c in configs} <= set(names)
    assert isinstance(names["placed_obstacles::ball"], Sphere)
    ours = obstacles.field.distances(points)
    # Drake's own iterations end at about 1e-15 m; poses are written with all their digits.
    assert_allclose(ours, truth, rtol=0, atol=1e-9)
    assert (ours < 0.0).any()
    assert (ours < bay.distances(points) - 1e-6).sum() > 40
    again = read_distance_field(moved / "scene.dmd.yaml")
    assert_allclose(again.distances(points), ours, rtol=0, atol=1e-12)
    assert set(again.bodies) == set(obstacles.field.bodies)


def test_obstacles_need_no_other_scene_and_a_scene_no_obstacles(configs, bay, tmp_path):
    alone = Obstacles.of(SignedDistanceField.of([]), configs)
    assert read_distance_field(alone.write_scene(tmp_path, "")).bodies == alone.field.bodies
    other = tmp_path / "none"
    other.mkdir()
    scene = Obstacles(bay).write_scene(other, "cargo_bay")
    assert read_distance_field(scene).bodies == bay.bodies
    third = tmp_path / "third"
    third.mkdir()
    with pytest.raises(InputError, match="must not name files of a package of its own"):
        alone.write_scene(third, str(tmp_path / "scene.dmd.yaml"))
    # Without one a file can stand below, by its path.
    shutil.copy(find_scene_file("trajectory_4"), tmp_path / "third" / "mine.dmd.yaml")
    below = read_distance_field(alone.write_scene(other, str(third / "mine.dmd.yaml")))
    assert {"payload::payload", "pallet::pallet", *alone.field.bodies} == set(below.bodies)
    with pytest.raises(InputError, match=r"hull\.obj: obstacles cannot be placed in it"):
        Obstacles(bay).write_scene(third, "hull.obj")


@pytest.mark.parametrize(
    "grid",
    [
        Grid(
            lower=np.array([4.4, -math.pi, 1.5]),
            upper=np.array([9.0, math.pi, 2.28]),
            shape=(46, 64, 8),
            unfolded=True,
            origin=np.array([-1.621, 0.0, 0.0]),
        ),
        Grid(
            lower=np.array([-2.0, -2.3, 4.8]), upper=np.array([0.66, 2.3, 9.0]), shape=(27, 46, 42)
        ),
    ],
    ids=["unfolded", "box"],
)
def test_cells_follow_obstacles_as_if_looked_at_anew(grid, bay, configs):
    """Placed, moved and removed one after another: all cells as of a fresh occupancy."""
    obstacles = Obstacles(bay)
    occupancy = Occupancy.of(bay, grid, 0.12)
    before = occupancy.padded.copy()
    steps = [
        *(lambda o, c=c: o.placed(c) for c in configs),
        lambda o: o.moved("locker", [0.2, 0.9, 6.0]),
        lambda o: o.moved("pole", [-0.5, -1.7, 6.2], [80.0, 0.0, 0.0]),
        lambda o: o.removed("ball"),
    ]
    changed = 0
    for step in steps:
        obstacles = step(obstacles)
        last, occupancy = occupancy, occupancy.updated(obstacles.field)
        assert_array_equal(occupancy.padded, Occupancy.of(obstacles.field, grid, 0.12).padded)
        changed += (occupancy.padded != last.padded).any()
    assert changed == len(steps)
    for name in obstacles.names:
        obstacles = obstacles.removed(name)
    assert obstacles.field is bay
    assert_array_equal(occupancy.updated(obstacles.field).padded, before)


def test_sets_do_not_change_and_names_are_kept(configs, bay):
    three = Obstacles.of(bay, configs[:3])
    four = three.placed(configs[3])
    moved = four.moved("ball", [0.0, 0.0, 5.0])
    assert three.names == ("locker", "ball", "pole")
    assert four.names == moved.names == ("locker", "ball", "pole", "pipe")
    assert four.configs[1].position_m == [0.2, -0.6, 6.5]
    assert moved.removed("locker").names == ("ball", "pole", "pipe")
    # What did not change is the same object, which is how an occupancy knows.
    assert [a is b for a, b in zip(four.shapes, moved.shapes, strict=True)] == [1, 0, 1, 1]
    with pytest.raises(InputError, match="obstacle 'ball' is there already"):
        four.placed(configs[1])
    for change in (lambda: four.removed("bal"), lambda: four.moved("bal", [0.0, 0.0, 0.0])):
        with pytest.raises(UnknownNameError, match=r"unknown obstacle 'bal'.*did you mean 'ball'"):
            change()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"size_m": [-0.1, 1.0, 1.0]}, r"crate\.size_m = -0\.1 m; must be 0\.001 \.\. 1000 m"),
        ({"size_m": [1.0]}, "must be of a box: along x, y and z"),
        ({"size_m": [1.0, 1.0, math.nan]}, "must be a finite number"),
        ({"position_m": [0.0, math.nan, 1.0]}, "must be a finite number"),
        ({"position_m": [0.0]}, r"crate\.position_m = \[0\.0\]; must be three numbers"),
        ({"rpy_deg": [0.0]}, r"crate\.rpy_deg = \[0\.0\]; must be three numbers"),
        ({"kind": "cone"}, "must be box or sphere or cylinder or capsule"),
        ({"name": "a/b"}, "must be a letter, then letters"),
    ],
)
def test_what_cannot_be_an_obstacle_is_refused(changed, words, bay, tmp_path):
    good = {"name": "crate", "kind": "box", "size_m": [1.0, 1.0, 1.0]}
    with pytest.raises(InputError, match=words):
        Obstacles(bay).placed(ObstacleConfig(**(good | changed)))
    text = json.dumps({"obstacles": [good | changed]}).replace("NaN", ".nan")
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as error:
        load_obstacles(tmp_path / "bad.yaml")
    assert "bad.yaml: " in str(error.value)


def test_a_name_that_stands_twice_in_a_file_is_refused(tmp_path):
    one = {"name": "crate", "size_m": [1.0, 1.0, 1.0]}
    (tmp_path / "twice.yaml").write_text(json.dumps({"obstacles": [one, one]}))
    with pytest.raises(InputError, match=r"twice\.yaml: obstacles: name = crate \(twice\)"):
        load_obstacles(tmp_path / "twice.yaml")


@pytest.mark.parametrize(("height", "hits"), [(3.0, True), (6.0, False)])
def test_the_arm_collides_with_an_obstacle_that_was_placed(height, hits, tmp_path):
    """A ball on the base line: the prototype at home reaches up to 4.44 m, and no farther."""
    ball = ObstacleConfig(name="ball", kind="sphere", size_m=[0.4], position_m=[0.413, 0.0, height])
    file = Obstacles.of(SignedDistanceField.of([]), [ball]).write_scene(tmp_path, "")
    scenario = SerpentineScenario(path="trajectory_4", scene=file.name, mounting="pad")
    setup = load_setup(scenario, folder=tmp_path)
    (query,) = place_arm(scenario, setup).posed(setup.arm.joint_home[None])
    assert query.HasCollisions() == hits
