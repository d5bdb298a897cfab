"""Gaps are distances between points of bodies, wherever the bodies stand."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw

from pips_drake.serpentine.systems.loop_gap_meter import LoopGapMeter

BODIES = [[1, 2], [2, 0]]
POINTS = [[[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]], [[0.0, 0.0, 0.0], [0.3, 0.0, 0.4]]]


def gaps(poses):
    meter = LoopGapMeter(BODIES, POINTS)
    context = meter.CreateDefaultContext()
    meter.GetInputPort("body_poses").FixValue(context, Value[list[RigidTransform]](poses))
    return meter.GetOutputPort("gap").Eval(context)


def test_ports_and_feedthrough(port_sizes):
    meter = LoopGapMeter(BODIES, POINTS)
    assert port_sizes(meter) == ({"body_poses": 0}, {"gap": 2})
    assert meter.HasDirectFeedthrough(0, 0)


def test_bodies_at_the_origin_have_their_points_as_far_apart_as_stated():
    # 0.1 and 0.2 m along x and y; a 3-4-5 triangle.
    expected = [np.hypot(0.1, 0.2), 0.5]
    np.testing.assert_allclose(gaps([RigidTransform()] * 3), expected, rtol=1e-15)


def test_bodies_that_meet_have_no_gap_and_moved_apart_theirs():
    # Body 2 stands so that its point (0, 0.2, 0) meets body 1's (0.1, 0, 0); body 0 so that its
    # point (0.3, 0, 0.4) is 2 mm off body 2's origin.
    X_W1 = RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), [1.0, 2.0, 3.0])
    R_W2 = RollPitchYaw(-1.0, 0.2, 0.7).ToRotationMatrix()
    X_W2 = RigidTransform(R_W2, X_W1 @ [0.1, 0.0, 0.0] - R_W2 @ [0.0, 0.2, 0.0])
    R_W0 = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix()
    off = X_W2.translation() + np.array([0.0, 2e-3, 0.0])
    X_W0 = RigidTransform(R_W0, off - R_W0 @ [0.3, 0.0, 0.4])
    found = gaps([X_W0, X_W1, X_W2])
    # Roundings of coordinates of a few metres.
    assert found[0] == pytest.approx(0.0, abs=2e-15)
    assert found[1] == pytest.approx(2e-3, abs=2e-15)
