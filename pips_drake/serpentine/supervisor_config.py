"""A scenario's section `supervisor`: where the motion supervisor acts."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

import math
from dataclasses import dataclass

from pips_drake.config import require
from pips_drake.serpentine.supervision_causes import Thresholds

#: Longest time that a supervisor's settings may ask for, s.
_LONGEST = 86400.0


@dataclass
class SupervisorConfig:
    """What watches the arm while it moves, and holds it, takes it back or stops it.

    Hold thresholds lie beyond what a run in order comes to, so that a supervisor changes a run only
    if something is wrong.
    """

    # Without it nothing intervenes: a run goes on into whatever stands in the way.
    enabled: bool = True
    # The tip is held so early that this much clearance to the scene is left when it has come to
    # rest, mm. Below the 25 mm that `checks` ask of a plan: what is planned to be near is not held.
    hold_clearance_mm: float = 20.0
    # From here on motion is free again, mm.
    resume_clearance_mm: float = 25.0
    # Nearer than this the arm goes back at once, mm: something moves towards it.
    retract_clearance_mm: float = 10.0
    # The same of the arm to itself and its rail, mm; half of the first is too near at any speed.
    own_hold_clearance_mm: float = 5.0
    own_resume_clearance_mm: float = 8.0
    # Farthest that a spine point may be from its command, mm: more than twice the sag of an arm
    # whose deflection is not compensated (17 mm on trajectory 4).
    tracking_hold_mm: float = 40.0
    tracking_resume_mm: float = 25.0
    # Held for its tracking error, an arm stops at once if that grows by as much more, mm, while no
    # drive needs more than `force_fraction_resume`: a drive runs away. Nearly twice what a tip at
    # 45 mm/s goes on until it is held (11 mm), by which an arm that follows no more falls behind.
    tracking_growth_mm: float = 20.0
    # Largest share of its limit that a drive may need. `motion.profile: fastest` plans up to 0.95.
    force_fraction_hold: float = 0.98
    force_fraction_resume: float = 0.8
    # Clearances that fall, and tracking errors that grow, more slowly are taken to stand, mm/s: a
    # hand that swings at 3 Hz by 0.05 mm moves as fast.
    closing_speed_mm_per_s: float = 1.0
    # How much clearance may be lost on the way out of a hold, mm, before that way is barred too.
    give_way_mm: float = 5.0
    # How long a cause must be past its resume threshold, and the arm within `tracking_resume_mm` of
    # its place, before motion is free again, s. More than a period of the arm's lowest mode (3 Hz):
    # an arm that swings passes thresholds several times a second.
    quiet_s: float = 0.5
    # Time to come from the profile's speed to a hold, s. More than a period of the arm's lowest
    # mode (3 Hz), so that it comes to rest without swinging.
    hold_ramp_s: float = 0.5
    # How long the arm is held with no way on before it goes back (clearances, force) or stops
    # (tracking, encoders, no free way back), s. 0: held until somebody commands otherwise.
    patience_s: float = 5.0
    # Share of the path's speeds at which it goes back by itself.
    safe_speed_fraction: float = 0.5
    # A run that is held may take this much longer than its path and a retraction of it need, s.
    overtime_s: float = 60.0

    def validate(self) -> None:
        for name in (
            "retract_clearance_mm",
            "own_hold_clearance_mm",
            "tracking_growth_mm",
            "quiet_s",
            "closing_speed_mm_per_s",
            "give_way_mm",
            "patience_s",
            "overtime_s",
        ):
            value = getattr(self, name)
            require(value >= 0.0, f"supervisor.{name}", value, ">= 0")
        for low, high in (
            ("retract_clearance_mm", "hold_clearance_mm"),
            ("hold_clearance_mm", "resume_clearance_mm"),
            ("own_hold_clearance_mm", "own_resume_clearance_mm"),
            ("tracking_resume_mm", "tracking_hold_mm"),
            ("force_fraction_resume", "force_fraction_hold"),
        ):
            # Without room between them a cause would come and go at every look.
            value, below = getattr(self, high), getattr(self, low)
            require(value > below, f"supervisor.{high}", value, f"> {low} ({below:g})")
        for name in ("tracking_resume_mm", "force_fraction_resume", "hold_ramp_s"):
            value = getattr(self, name)
            require(value > 0.0, f"supervisor.{name}", value, "> 0")
        share = self.safe_speed_fraction
        require(0.01 <= share <= 1.0, "supervisor.safe_speed_fraction", share, "0.01 .. 1")
        for name in ("hold_ramp_s", "quiet_s", "patience_s", "overtime_s"):
            value = getattr(self, name)
            require(value <= _LONGEST, f"supervisor.{name}", value, f"<= {_LONGEST:g}")

    def thresholds(self, latency: float) -> Thresholds:
        """In SI.

        Args:
            latency: from a change of clearance to the plant's answer, s.
        """
        return Thresholds(
            hold_clearance=self.hold_clearance_mm * 1e-3,
            resume_clearance=self.resume_clearance_mm * 1e-3,
            retract_clearance=self.retract_clearance_mm * 1e-3,
            own_hold_clearance=self.own_hold_clearance_mm * 1e-3,
            own_resume_clearance=self.own_resume_clearance_mm * 1e-3,
            tracking_hold=self.tracking_hold_mm * 1e-3,
            tracking_resume=self.tracking_resume_mm * 1e-3,
            tracking_growth=self.tracking_growth_mm * 1e-3,
            force_hold=self.force_fraction_hold,
            force_resume=self.force_fraction_resume,
            closing_speed=self.closing_speed_mm_per_s * 1e-3,
            give_way=self.give_way_mm * 1e-3,
            quiet_time=self.quiet_s,
            stopping_time=latency + 0.5 * self.hold_ramp_s,
            patience=self.patience_s or math.inf,
            safe_share=self.safe_speed_fraction,
        )
