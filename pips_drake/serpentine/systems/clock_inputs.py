"""What the sources of motions hear: a word, and a share of their speed."""

from __future__ import annotations

from pydrake.systems.framework import Context, InputPort

from pips_drake.config import require
from pips_drake.serpentine.motion_clock import check_word
from pips_drake.serpentine.motion_words import RUN


def heard_word(where: str, port: InputPort, context: Context) -> float:
    """The word at a port, `RUN` when it is unconnected.

    Args:
        where: names the port in a message.

    Raises:
        InputError: it is none of `motion_words`.
    """
    if not port.HasValue(context):
        return RUN
    return check_word(where, float(port.Eval(context)[0]))


def heard_share(where: str, port: InputPort, context: Context) -> float:
    """The share of the speed at a port, 1 when it is unconnected.

    Raises:
        InputError: it is not above 0 and at most 1.
    """
    if not port.HasValue(context):
        return 1.0
    share = float(port.Eval(context)[0])
    require(0.0 < share <= 1.0, where, share, "> 0 and <= 1")
    return share
