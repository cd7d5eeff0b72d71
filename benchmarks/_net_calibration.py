"""Calibration error of forecasts without the contribution of chance."""

import math
from collections.abc import Sequence

import numpy as np

from dpr_lab.trials.score import Claim


def net_calibration_error(groups: Sequence[Sequence[Claim]], bins: int = 10) -> float:
    """Compute the root mean square calibration error without the contribution of chance.

    Claims of one group may be correlated; the groups are independent. In one bin, s_i is the sum of outcome minus
    probability over the claims of group i, n is the number of claims of all groups, and m is the number of groups with
    claims. The sum of s_i s_j over i != j is on average zero for a calibrated forecast. The squared error is

        sum over bins of  m / (m - 1) (sum over i != j of s_i s_j) / n,  divided by the number of all claims.

    The average of the squared error does not depend on the number of groups. If the squared error is negative by
    chance, the result is 0. Bins with claims of only one group do not contribute. On average, the result is at least as
    large as the mean absolute error.

    Source: A. Kumar, P. Liang & T. Ma (2019), Verified uncertainty calibration, NeurIPS 32, for groups of one claim.

    Args:
        groups: claims of each independent trial
        bins: number of bins of equal width
    """
    missed, count = np.zeros((2, len(groups), bins))
    for group, claims in enumerate(groups):
        for claim in claims:
            number = min(int(claim.probability * bins), bins - 1)
            missed[group, number] += claim.true - claim.probability
            count[group, number] += 1
    members, size = np.sum(count > 0, axis=0), count.sum(axis=0)
    squares = (missed.sum(axis=0) ** 2 - np.sum(missed**2, axis=0)) * members / np.maximum(members - 1, 1)
    total = float(np.sum(squares[size > 0] / size[size > 0]))
    return math.sqrt(max(total, 0.0) / size.sum()) if size.any() else math.nan
