"""What an autopilot is to do, step by step, as it stands in a scenario."""
# Annotations must be real types here: pydrake's YAML reader does not resolve strings.

from dataclasses import dataclass, field

from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.configuration import STATIONS

#: Fields that each word needs, and those that it may have.
WORDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    # The palm above the bar, aligned with it; follows a payload that moves.
    "approach": (("height_m",), ("speed_m_s",)),
    # Down onto the bar.
    "descend": ((), ("speed_m_s",)),
    # Close the prong until the payload is held, or the time is over.
    "close": ((), ("seconds",)),
    # Open the prong until it is wide open.
    "open": ((), ()),
    # Away from the bar, along the arm's own x2.
    "retreat": (("height_m",), ("speed_m_s",)),
    # The payload (or the palm) by so much in {R}, turned by so much about {R}'s axes.
    "carry": ((), ("by_m", "turn_deg", "speed_m_s")),
    # The payload's probe before the port, aligned with it; `offset_m`, in {C}, misses on purpose.
    "carry_to_port": (("standoff_m",), ("offset_m", "speed_m_s")),
    # Straight into the port until it docks, or the time is over.
    "dock": ((), ("offset_m", "speed_m_s", "seconds")),
    # Open the port's latch until the payload is free of it.
    "undock": ((), ("seconds",)),
    # The payload above its place in the bay; then down into it.
    "carry_to_berth": (("standoff_m",), ("speed_m_s",)),
    "berth": ((), ("speed_m_s",)),
    "telescope": (("to_m",), ()),
    "move_joints": (("angles_deg",), ()),
    "translate_orbiter": (("by_m",), ()),
    # Choose a camera station, and pan, tilt and zoom it by so much.
    "camera": (("station",), ("pan_deg", "tilt_deg", "zoom_deg")),
    "wait": (("seconds",), ()),
}
#: How many numbers the lists have.
_LENGTHS = {"by_m": 3, "turn_deg": 3, "offset_m": 3, "angles_deg": 6}


@dataclass
class ScriptStep:
    """One step; which fields a word has is in `WORDS`."""

    do: str = ""
    height_m: float = 0.0
    standoff_m: float = 0.0
    to_m: float = 0.0
    seconds: float = 0.0
    # Largest speed of the palm; 0: 0.15 m/s, with a payload 0.06 m/s.
    speed_m_s: float = 0.0
    by_m: list[float] = field(default_factory=list)
    turn_deg: list[float] = field(default_factory=list)
    offset_m: list[float] = field(default_factory=list)
    angles_deg: list[float] = field(default_factory=list)
    station: str = ""
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    zoom_deg: float = 0.0

    def validate(self) -> None:
        if self.do not in WORDS:
            raise UnknownNameError("step of the script: do", self.do, list(WORDS))
        needed, allowed = WORDS[self.do]
        for name in needed:
            if not getattr(self, name):
                raise InputError(f"step {self.do}: no {name}; must have one")
        for name, default in vars(ScriptStep()).items():
            given = getattr(self, name) != default
            if name != "do" and given and name not in (*needed, *allowed):
                fields = ", ".join((*needed, *allowed)) or "nothing"
                raise InputError(f"step {self.do}: {name} given; it takes {fields}")
        for name, length in _LENGTHS.items():
            value = getattr(self, name)
            good = len(value) in (0, length)
            require(good, f"step {self.do}: {name}", value, f"{length} numbers")
        if self.do == "carry" and not (self.by_m or self.turn_deg):
            raise InputError("step carry: neither by_m nor turn_deg; must have one")
        for name in ("height_m", "standoff_m", "to_m"):
            value = getattr(self, name)
            require(0.0 <= value <= 100.0, f"step {self.do}: {name}", f"{value} m", "0 .. 100 m")
        speed = self.speed_m_s
        good = speed == 0.0 or 1e-3 <= speed <= 1.0
        require(good, f"step {self.do}: speed_m_s", f"{speed} m/s", "0.001 .. 1 m/s")
        good = 0.0 <= self.seconds <= 86400.0
        require(good, f"step {self.do}: seconds", self.seconds, "0 .. 86400")
        if self.station and not (len(self.station) == 1 and self.station in STATIONS):
            raise UnknownNameError("camera station", self.station, STATIONS)
