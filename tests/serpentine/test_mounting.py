"""How frame {0} stands: FACTS' columns, and proper rotations."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import UnknownNameError
from pips_drake.serpentine.mounting import MOUNTINGS, mounting_rotation

# FACTS: columns x0, y0, z0 in the world, z up.
COLUMNS = {
    "laboratory": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "pad": [(0, 0, -1), (0, 1, 0), (1, 0, 0)],
    "pad_below": [(0, 0, 1), (0, -1, 0), (1, 0, 0)],
}


def test_the_mountings_are_the_documents():
    assert set(MOUNTINGS) == set(COLUMNS)


@pytest.mark.parametrize("name", sorted(COLUMNS))
def test_columns_are_the_axes_that_the_document_states(name):
    np.testing.assert_array_equal(mounting_rotation(name).T, COLUMNS[name])


@pytest.mark.parametrize("name", sorted(COLUMNS))
def test_mountings_are_rotations(name):
    # Entries are 0 and 1: exact.
    rotation = mounting_rotation(name)
    np.testing.assert_array_equal(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == 1.0


def test_on_the_pad_the_rail_is_overhead_and_the_arm_hangs_beside_it():
    # x0, from the rail to the arm, points down; below, it points up.
    assert (mounting_rotation("pad") @ [1.0, 0.0, 0.0])[2] == -1.0
    assert (mounting_rotation("pad_below") @ [1.0, 0.0, 0.0])[2] == 1.0


def test_nobody_can_turn_a_mounting_for_the_others():
    mounting_rotation("pad")[:] = 0.0
    np.testing.assert_array_equal(mounting_rotation("pad").T, COLUMNS["pad"])


def test_an_unknown_mounting_lists_the_known_ones():
    message = r"unknown mounting 'ceiling'; known: laboratory, pad, pad_below"
    with pytest.raises(UnknownNameError, match=message):
        mounting_rotation("ceiling")
