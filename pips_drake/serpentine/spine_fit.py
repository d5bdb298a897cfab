"""Compiled fit of an arm's spine points to the path, tip to base (FTL-95 section 3.3.2).

Arrays are in lanes (`solver`): their last axis, L, are tip positions that are fitted side by side.
"""

from __future__ import annotations

import numba

from pips_drake.serpentine.path_geometry import START, find_piece, piece_position, walk_back


@numba.njit(cache=True)
def place_tips(table, s_tips, spine, arc_lengths, tip_piece):
    """Puts the lanes' last spine points on the path, and says on which piece."""
    last = spine.shape[0] - 1
    for n in range(s_tips.size):
        piece = find_piece(table, s_tips[n])
        spine[last, 0, n], spine[last, 1, n], spine[last, 2, n] = piece_position(
            table, piece, s_tips[n] - table[piece, START]
        )
        arc_lengths[last, n] = s_tips[n]
        tip_piece[n] = piece


@numba.njit(cache=True, error_model="numpy")
def fit_spines(table, tip_piece, q_lengths, running, spine, arc_lengths, piece, missing):
    """Places the running lanes' spine points on the path, tip to base (FTL-95 section 3.3.2).

    Args:
        tip_piece: pieces that the tips stand on (L,).
        q_lengths: module lengths (M, L), m.
        running: which lanes to do, (L,).
        spine, arc_lengths: in and out, as in `_solve_lanes`; only the tips' are read.
        piece: scratch (L,).
        missing: out, index of the module that found no intersection, or -1, (L,).
    """
    last = spine.shape[0] - 1
    for n in range(running.size):
        if running[n]:
            piece[n], missing[n] = tip_piece[n], -1
    # Lanes inside modules: one lane's walk waits for the last one's root, the others' need not.
    for i in range(last - 1, -1, -1):
        for n in range(running.size):
            if not running[n] or missing[n] >= 0:
                continue
            start = table[piece[n], START]
            here, local = walk_back(
                table,
                piece[n],
                arc_lengths[i + 1, n] - start,
                spine[i + 1, 0, n],
                spine[i + 1, 1, n],
                spine[i + 1, 2, n],
                q_lengths[i, n],
            )
            if here < 0:
                missing[n] = i
                continue
            spine[i, 0, n], spine[i, 1, n], spine[i, 2, n] = piece_position(table, here, local)
            arc_lengths[i, n] = table[here, START] + local
            piece[n] = here
