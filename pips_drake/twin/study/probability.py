"""What a share of draws that passed says of the probability of passing."""

from __future__ import annotations

#: Of the interval.
CONFIDENCE = 0.95


def pass_probability(passed: int, draws: int) -> tuple[float, float, float]:
    """The share that passed, and the ends of Clopper and Pearson's interval.

    It covers the true probability in at least `CONFIDENCE` of all studies, whatever that is.
    """
    from scipy.stats import binomtest

    found = binomtest(passed, draws)
    low, high = found.proportion_ci(confidence_level=CONFIDENCE, method="exact")
    return passed / draws, float(low), float(high)
