"""What is drawn agrees with what is computed."""

from dataclasses import replace

import numpy as np
import pytest

from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.kinematics import frames
from pips_drake.serpentine.truss import MOST_BAYS, actuator_pins, segment_struts


@pytest.mark.parametrize("name", ["prototype", "pcr_concept", "cmu_92"])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_pins_are_as_far_apart_as_the_linkage_says(name, mirrored):
    arm = replace(load_arm(name), mirrored=mirrored)
    inner, outer = actuator_pins(arm)
    first = arm.first_actuated_joint
    rng = np.random.default_rng(3)
    for q in rng.uniform(arm.joint_lower, arm.joint_upper, (20, arm.joints)):
        X = frames(arm, q)[0]
        apart = [
            np.linalg.norm(X[j - 1] @ [*inner[j - first], 1.0] - X[j] @ [*outer[j - first], 1.0])
            for j in range(first, arm.joints)
        ]
        # Positions are of a few metres: rounding is 1e-15 of that.
        np.testing.assert_allclose(apart, arm.linkage.length(q[first:]), atol=1e-13)


def test_a_segments_struts_stay_inside_the_box_that_collides():
    arm = load_arm("prototype")
    for body in arm.bodies[2::2][:8]:
        low, high = body.centre - 0.5 * body.size, body.centre + 0.5 * body.size
        for strut in segment_struts(body):
            for end in (strut.start, strut.end):
                # Rounding of the corners; longerons are inset by their radius.
                assert np.all(end >= low - 1e-12), body.name
                assert np.all(end <= high + 1e-12), body.name


def test_a_segment_of_kilometres_is_drawn_with_long_bays():
    """A misplaced digit in an arm file must not take minutes to export."""
    body = load_arm("prototype").bodies[2]
    long = replace(body, size=body.size * [1e4, 1.0, 1.0])
    # Four in a frame, and eight in a bay; a point at each end.
    assert len(segment_struts(long)) == 4 * (MOST_BAYS + 1) + 8 * MOST_BAYS + 8
