"""Unit conversions, exact by definition. Inside the package everything is SI and radians."""

from __future__ import annotations

import math
from collections.abc import Iterable

#: One inch, m (exact since 1959).
INCH = 0.0254
#: One foot, m.
FOOT = 0.3048
#: One degree, rad.
DEGREE = math.pi / 180.0

#: Length units that a file may use, by the suffix that its column or key carries, m.
LENGTH_UNITS = {"in": INCH, "m": 1.0}
#: Units of a joint value, by the word a limit row may use, m or rad.
JOINT_UNITS = {"in": INCH, "m": 1.0, "deg": DEGREE, "rad": 1.0}


def in_inches(point: Iterable[float]) -> str:
    """A point given in m as text in inches, the unit of FTL-95's tables."""
    return "(" + ", ".join(f"{round(value / INCH, 3) + 0.0:.3f}" for value in point) + ") in"
