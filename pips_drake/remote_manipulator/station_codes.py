"""Numbers and voltages of the camera stations."""

from __future__ import annotations

from pips_drake.remote_manipulator.configuration import STATIONS

#: Bits 8 to 11 of the control word, by station. A to H stand in RMS-71's Table II, which leaves out
#: 5 to 7 and station I: it gets the next code, and section VII's four stations the last ones (both
#: assumed).
STATION_CODES = dict(zip(STATIONS, (0, 1, 2, 3, 4, 8, 9, 10, 11, 12, 13, 14, 15), strict=True))
#: Stations by code.
STATIONS_BY_CODE = {code: station for station, code in STATION_CODES.items()}

#: Level of channel 12 by station, in eighths of the full scale. A to H stand in Table I (its "+zV"
#: and "-3V" are misprints of a half). I gets the quarter that is left, section VII's stations odd
#: eighths (both assumed).
STATION_EIGHTHS = dict(zip(STATIONS, (8, 6, 4, 2, 0, -2, -4, -8, -6, 7, 5, 3, 1), strict=True))
