"""What the whole recording tells of each picture's centres: uneven light taken out, uncertainties made whole."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.follow import Follower
from evaluator.tracking.shading import learn_shading
from evaluator.tracking.uncertainty import distance_ratio, hidden_variance

Array = NDArray[np.float64]


def refine(time_s: Array, kinds: Sequence[str], numbers: dict[str, Array], followers: dict[str, Follower]) -> None:
    """Correct centres and complete variances in place.

    kinds: of the pictures. numbers: per mark (n, 5) of x, y, their variances and covariance, px and px², NaN if absent.
    """
    kind = np.array(list(kinds), dtype=str)
    for name, values in numbers.items():
        follower = followers.get(name)
        if follower is None or not len(values):
            continue
        shading = learn_shading(follower.look.disc, follower.black, *follower.slopes())
        if shading is not None:
            shift, variance = shading.shift(values[:, :2])
            values[:, :2] -= shift
            values[:, 2:4] += variance[:, None]
        values[:, 2:4] += hidden_variance(time_s, values[:, :2], values[:, 2:4].mean(axis=1), kind)[:, None]
    for first, second in combinations(numbers, 2):
        if {first, second} == {"green", "yellow"}:  # the marks of one robot; others may move apart
            one, other = numbers[first], numbers[second]
            mean = one[:, 2:4].mean(axis=1), other[:, 2:4].mean(axis=1)
            ratio = distance_ratio(one[:, :2], other[:, :2], mean)
            if ratio > 1.0:
                one[:, 2:5] *= ratio
                other[:, 2:5] *= ratio
