"""Measurements that a supervisor may meet, and its decisions after them."""

from __future__ import annotations

from dataclasses import replace

from pips_drake.serpentine.motion_words import EXTENDING, RUN
from pips_drake.serpentine.supervision import Cause, Decision, Measurement, command_of, decide
from pips_drake.serpentine.supervisor_config import SupervisorConfig

PERIOD = 1.0 / 32.0
LATENCY = 0.1
SPEED = 0.025
#: Hold at 20 mm, resume at 25, retract at 10; own 5 and 8; tracking 40 and 25, and
#: 20 more; force 0.98 and 0.8; quiet for 0.5 s.
CONFIG = SupervisorConfig()
THRESHOLDS = CONFIG.thresholds(LATENCY)

#: An arm that moves on in free space.
FREE = Measurement(
    clearance=0.5,
    clearance_rate=0.0,
    own_clearance=0.17,
    own_rate=0.0,
    tracking_error=0.5e-3,
    force_share=0.4,
    healthy=True,
    tip_rate=SPEED,
    phase=EXTENDING,
    wish=RUN,
)
STANDING = replace(FREE, tip_rate=0.0)

#: What makes each lasting cause active, and what is between its thresholds, and clear of both.
TRIGGERS = {
    Cause.CLEARANCE: [
        {"clearance": 0.009},
        {"clearance": 0.022},
        {"clearance": 0.026},
    ],
    Cause.SELF_CLEARANCE: [
        {"own_clearance": 0.002},
        {"own_clearance": 0.006},
        {"own_clearance": 0.009},
    ],
    Cause.TRACKING: [
        {"tracking_error": 0.041},
        {"tracking_error": 0.030},
        {"tracking_error": 0.024},
    ],
    Cause.FORCE: [{"force_share": 0.99}, {"force_share": 0.9}, {"force_share": 0.79}],
    Cause.ENCODER: [{"healthy": False}],
}


def after(*seen, before=None, thresholds=THRESHOLDS):
    """The decision after a sequence of measurements."""
    decision = before or Decision()
    for one in seen:
        decision = decide(decision, one, thresholds, PERIOD)
    return decision


def command(decision, seen):
    return command_of(decision, seen.wish, seen.phase, THRESHOLDS.safe_share)


def held_ahead():
    """Held at rest, 20 mm before something that lies ahead."""
    closing = replace(FREE, clearance=0.028, clearance_rate=-SPEED)
    return after(closing, replace(STANDING, clearance=0.020))


def calm(decision, seen=STANDING):
    """The decision after half a second, and a period, in which nothing is wrong."""
    return wait(decision, seen, THRESHOLDS.quiet_time + PERIOD)


def wait(decision, seen, seconds, thresholds=THRESHOLDS):
    return after(*[seen] * round(seconds / PERIOD), before=decision, thresholds=thresholds)
