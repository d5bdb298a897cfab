"""Follow-the-leader from a cold start beside general inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.measuring import Array, Line, measure_in_turn
from benchmarks.peers import TOLERANCE, DrakeInverse, PinocchioInverse
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.path_file import load_path

Solver = Callable[[Array, Array], Array]


def measure(*, quick: bool) -> list[Line]:
    """Microseconds a tip position, and how far the answers are apart."""
    count, windows, length, rounds = (400, 2, 5, 2) if quick else (10_000, 10, 25, 7)
    arm = load_arm("prototype")
    path = load_path(find_path_file("trajectory_4"))
    leader = FollowTheLeader(arm)
    tips = np.linspace(path.home_arc_length, path.length, count)
    truth = leader.solve(path, tips)
    if not truth.solved.all():
        raise RuntimeError("follow-the-leader has not solved every point of trajectory 4")

    def ours() -> int:
        leader.solve(path, tips)
        return count

    # The peers are slow: windows of neighbouring points, evenly along the path. The point before a
    # window's first is given, too.
    starts = np.linspace(1, count - length, windows).astype(int)

    def by(solve: Solver, found: Array | None = None) -> int:
        for first in starts:
            joints = truth.joints[first - 1]
            for i in range(first, first + length):
                joints = solve(joints, truth.spine_points[i])
                if found is not None:
                    found[i] = joints
        return windows * length

    drake, pinocchio = DrakeInverse(arm), PinocchioInverse(arm)
    agreement = {}
    for name, solve in (("drake", drake.solve), ("pinocchio", pinocchio.solve)):
        found = np.full_like(truth.joints, np.nan)
        by(solve, found)
        done = np.isfinite(found[:, 0])
        apart = np.abs(found[done] - truth.joints[done]).max()
        missed = kinematics.spine_points(arm, found[done]) - truth.spine_points[done]
        error = np.linalg.norm(missed, axis=2).max(axis=1)
        agreement[name] = {
            "joints apart at most (m, rad)": float(apart),
            "spine error at most (m)": float(error.max()),
            "points": float(done.sum()),
            # Given 1e-12 m for the roundings of two forward kinematics.
            "points above 1e-9 in": float(np.sum(error > TOLERANCE + 1e-12)),
        }
    agreement["pinocchio"]["iterations a point"] = pinocchio.iterations / (windows * length)

    def calls() -> int:
        for first in starts:
            for i in range(first, first + length):
                pinocchio.calls_alone(truth.joints[i])
        return windows * length

    seconds = measure_in_turn(
        {
            "ours": ours,
            "drake": lambda: by(drake.solve),
            "pinocchio": lambda: by(pinocchio.solve),
            "calls": calls,
        },
        rounds=rounds,
    )
    ours_us = 1e6 * seconds["ours"]
    calls_us = 1e6 * float(np.median(seconds["calls"]))
    agreement["pinocchio"]["its own calls, an iteration (us)"] = calls_us
    iterations = float(truth.iterations.mean())
    own = (
        f"One thread and scalar arithmetic: {iterations:.1f} iterations a tip, each places "
        f"{arm.modules + 1} spine points on the path and turns them into joints"
    )
    what = f"FTL, cold start to 1e-9 in, {count:,} tips of trajectory 4"
    return [
        Line(
            name="ftl_drake",
            what=what,
            ours=ours_us,
            unit="us a tip",
            beside="Drake InverseKinematics (SNOPT), warm, spine points given",
            peer=1e6 * seconds["drake"],
            ratio_aim=300.0,
            value_aim=2.0,
            limits=own,
            agreement=agreement["drake"],
        ),
        Line(
            name="ftl_pinocchio",
            what=what,
            ours=ours_us,
            unit="us a tip",
            beside="pinocchio Gauss-Newton in Python, warm, spine points given",
            peer=1e6 * seconds["pinocchio"],
            ratio_aim=40.0,
            value_aim=2.0,
            limits=(
                f"Of an iteration of the peer {calls_us:.0f} us are its own calls, the rest is "
                "Python and numpy: in C++ it would be several times as fast"
            ),
            agreement=agreement["pinocchio"],
        ),
    ]
