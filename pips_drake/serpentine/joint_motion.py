"""A motion given by joints over time, for what no single path of the tip describes.

Tours that draw back and go on elsewhere, scans in which the whole arm moves aside, and recordings
of an operator: between rows the joints move on straight lines, as drives are commanded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class JointMotion:
    """Joints at times, straight in between.

    Attributes:
        times: (K,) s, from 0, increasing.
        joints: (K, J) m and rad.

    Raises:
        InputError: times or joints of the wrong shape, not finite, or times that do not begin at 0
            and increase.
    """

    times: Array
    joints: Array

    def __post_init__(self) -> None:
        times, joints = self.times, self.joints
        if times.ndim != 1 or len(times) < 2 or joints.ndim != 2 or len(joints) != len(times):
            raise InputError(
                f"joint motion with times of shape {times.shape} and joints of shape "
                f"{joints.shape}; must be (K,) and (K, joints), K >= 2"
            )
        if not (np.isfinite(times).all() and np.isfinite(joints).all()):
            raise InputError("joint motion; must be of finite numbers")
        if times[0] != 0.0 or (np.diff(times) <= 0.0).any():
            raise InputError("joint motion's times; must begin at 0 s and increase")

    @property
    def duration(self) -> float:
        """From the first row to the last, s."""
        return float(self.times[-1])

    def at(self, times: ArrayLike) -> Array:
        """Joints (N, J) m and rad at times (N,) s; before and after it they rest."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return np.stack([np.interp(t, self.times, column) for column in self.joints.T], axis=-1)

    def state(self, time: float) -> tuple[Array, Array]:
        """Joints (J,) m and rad at a time (s), and their rates there, (J,) m/s and rad/s.

        At a row the rates are those of the line that leads to it; before the first row they are
        those of the first line, after the last those of the last.
        """
        row = int(np.searchsorted(self.times, time)) - 1
        row = min(max(row, 0), len(self.times) - 2)
        step = self.times[row + 1] - self.times[row]
        rates: Array = (self.joints[row + 1] - self.joints[row]) / step
        # From the nearer end, so that rows are met to the last digit.
        share = min(max((time - self.times[row]) / step, 0.0), 1.0)
        near, far = (row, share) if share <= 0.5 else (row + 1, share - 1.0)
        joints: Array = self.joints[near] + far * step * rates
        return joints, rates
