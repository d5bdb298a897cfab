"""Capsules hold the bodies, and their distances are bounds."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.planning.arm_envelope import clearance_bound, make_envelope
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.links import make_links

from .corridor import corridor, distance_of_bodies


@pytest.mark.parametrize("name", ["cmu_92", "prototype"])
def test_every_corner_of_every_body_lies_in_its_capsule(name):
    arm = load_arm(name)
    envelope = make_envelope(arm)
    k = 0
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for j, link in enumerate(make_links(arm)[1:]):
        for shape in link.collisions:
            a, b, r = envelope.starts[k], envelope.ends[k], envelope.radii[k]
            assert (envelope.frames[k], envelope.names[k]) == (j, link.name)
            half = 0.5 * shape.size if shape.kind == "box" else np.zeros(3)
            corners = shape.centre + signs * half
            way = b - a
            t = np.clip((corners - a) @ way / max(way @ way, 1e-30), 0.0, 1.0)[:, None]
            far = np.linalg.norm(corners - a - t * way, axis=1)
            far = far + (shape.size[0] if shape.kind == "sphere" else 0.0)
            # And on its surface: no wider than need be.
            np.testing.assert_allclose(far, r, rtol=0, atol=1e-12)
            k += 1
    assert k == len(envelope.radii)


def test_the_bound_is_below_what_is_sampled_by_less_than_its_finest_piece_where_it_matters():
    arm = load_arm("cmu_92")
    envelope = make_envelope(arm)
    rng = np.random.default_rng(6)
    field = corridor((0.6, 0.4, 12.0, 0.1), (0.3, -0.6, 14.0, 0.15))
    gaps = []
    for _ in range(6):
        joints = arm.joint_home.copy()
        joints[0] += rng.uniform(0.0, 6.0)
        joints[3:-1] += np.radians(rng.uniform(-5.0, 5.0, arm.joints - 4))
        first, last = envelope.axes(arm, joints, np.zeros(3))
        share = np.linspace(0.0, 1.0, 500)[:, None, None]
        points = first + share * (last - first)
        sampled = field.distances(points.reshape(-1, 3)).reshape(500, -1) - envelope.radii
        # Samples are at most half of 0.46 m / 500 from the nearest point: 0.5 mm.
        bound = clearance_bound(field, first, last, envelope.radii, enough=sampled.min() + 1e-9)
        assert bound <= sampled.min() + 5e-4
        gaps.append(sampled.min() - bound)
        # What is enough is not looked at closely, and is a bound all the same.
        lax = clearance_bound(field, first, last, envelope.radii, enough=sampled.min() - 0.05)
        assert sampled.min() - 0.05 <= lax <= sampled.min() + 5e-4
        assert distance_of_bodies(arm, field, joints) >= bound
    # Half of the finest piece, 1 mm, and what samples miss.
    assert max(gaps) <= 1.6e-3


def test_nothing_is_infinitely_far():
    arm = load_arm("cmu_92")
    envelope = make_envelope(arm)
    first, last = envelope.axes(arm, arm.joint_home, np.zeros(3))
    empty = SignedDistanceField.of([])
    assert clearance_bound(empty, first, last, envelope.radii, enough=0.03) == np.inf
