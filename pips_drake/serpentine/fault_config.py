"""A scenario's section `faults`: what goes wrong in a run, where, when and how much."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.config import require

#: Faults of a drive, of an encoder, of how the arm is built, and the others.
DRIVE_FAULTS = ("jam", "slow", "runaway", "limited", "weak")
ENCODER_FAULTS = ("dead", "stuck", "biased", "quantised")
BUILD_FAULTS = ("segment_length", "anchor")
OTHER_FAULTS = ("payload_displaced", "disturbance", "late")
FAULTS = DRIVE_FAULTS + ENCODER_FAULTS + BUILD_FAULTS + OTHER_FAULTS
#: Faults that do not say how much by `size`.
_UNSIZED = ("jam", "dead", "stuck", "payload_displaced", "disturbance")
#: Faults that are there all the time.
_LASTING = (*BUILD_FAULTS, "payload_displaced")
#: Largest errors of a segment's length and of an actuator's pin, mm: beyond them it is another arm.
_LONGEST_ERROR = {"segment_length": 100.0, "anchor": 25.0}
#: Longest time that a fault may name, s.
_LONGEST = 86400.0


@dataclass
class FaultConfig:
    """One fault of the hardware, or of what the plan believes of the scene. The plan knows none.

    What a kind does not use must be left out.
    """

    # Of a drive, whose set-point it changes. jam: it stands still. slow: its speed limit is `size`
    # of the sound one's. runaway: it moves at `size` of its speed limit to an end of its stroke,
    # whatever is commanded; a negative one the other way. limited: its joint goes no farther than
    # `size` deg either way (d1: mm from its home). weak: its stiffness, and the force that it makes
    # with it, is `size` of the sound one's; an actuator's (L3, ...), in the fidelity `leg`.
    # Of an encoder, which the supervisor reads (the servos do not). dead: it reads zero and says
    # that it is not healthy. stuck: it stays at its last reading. biased: it reads `size` deg too
    # much (d1: mm). quantised: it reads in steps of `size` deg (d1: mm).
    # Of how the arm is built, all the time, where plan and controllers believe otherwise.
    # segment_length: a segment is `size` mm longer. anchor: an actuator's pin in the outer body is
    # `size` mm farther from its hinge.
    # Others. payload_displaced: a scene body stands `offset_mm` from where the plan believes it is,
    # all the time. disturbance: `force_n` acts at the arm's last body. late: of the servos'
    # updates only every `size`-th acts; 0 for none.
    kind: str = ""
    # Of a drive's fault: d1, theta2, L3, ...; of an anchor: L3, ...
    drive: str = ""
    # Of an encoder's fault: d1, theta2, theta3, ...
    encoder: str = ""
    # Of payload_displaced: a body of the scene, such as payload::payload.
    body: str = ""
    # Of segment_length: which, from 1 at the base.
    segment: int = 0
    # When it begins, and how long it lasts, s; 0 to the end of the run.
    start_s: float = 0.0
    duration_s: float = 0.0
    size: float = 0.0
    # Of payload_displaced, in the frame that the body is fixed to, mm.
    offset_mm: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Of disturbance, in the world, N.
    force_n: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def validate(self) -> None:
        kind = self.kind
        require(kind in FAULTS, "faults.kind", kind, f"one of {', '.join(FAULTS)}")
        for name, kinds in (
            ("drive", (*DRIVE_FAULTS, "anchor")),
            ("encoder", ENCODER_FAULTS),
            ("body", ("payload_displaced",)),
        ):
            value = getattr(self, name)
            allowed = "given" if kind in kinds else "left out"
            require((value != "") == (kind in kinds), f"faults.{name} of {kind}", value, allowed)
        number = self.segment
        if kind == "segment_length":
            require(number >= 1, f"faults.segment of {kind}", number, "1 or more")
        else:
            require(number == 0, f"faults.segment of {kind}", number, "left out")
        for name in ("start_s", "duration_s"):
            value = getattr(self, name)
            require(0.0 <= value <= _LONGEST, f"faults.{name}", value, f"0 .. {_LONGEST:g}")
            good = value == 0.0 or kind not in _LASTING
            require(good, f"faults.{name} of {kind}", value, "left out")
        for name, needed in (("offset_mm", "payload_displaced"), ("force_n", "disturbance")):
            value = getattr(self, name)
            require(len(value) == 3, f"faults.{name}", value, "3 numbers")
            if kind != needed:
                require(not any(value), f"faults.{name} of {kind}", value, "left out")
            else:
                require(any(value), f"faults.{name}", value, "not all zero")
        self._validate_size()

    def _validate_size(self) -> None:
        size, name = self.size, f"faults.size of {self.kind}"
        if self.kind in _UNSIZED:
            require(size == 0.0, name, size, "left out")
        elif self.kind == "slow":
            require(0.0 <= size < 1.0, name, size, "0 .. 1, below 1")
        elif self.kind == "weak":
            # A spring of nearly no stiffness would let the arm fall: that is no share of it.
            require(1e-3 <= size < 1.0, name, size, "0.001 .. 1, below 1")
        elif self.kind in BUILD_FAULTS:
            most = _LONGEST_ERROR[self.kind]
            good = 0.0 < abs(size) <= most
            require(good, name, size, f"-{most:g} .. {most:g} and not 0")
        elif self.kind == "runaway":
            require(0.0 < abs(size) <= 1.0, name, size, "-1 .. 1 and not 0")
        elif self.kind == "biased":
            require(size != 0.0, name, size, "not 0")
        elif self.kind == "late":
            require(size == 0.0 or size >= 2.0, name, size, "0, or 2 or more")
            require(size == int(size), name, size, "a whole number")
        else:
            require(size > 0.0, name, size, "> 0")
