"""Scatter that is chance is taken for chance, also where runs tell little of it; what depends on something is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from evaluator.diagnosis.assessment.adequacy import (
    Adequacy,
    _odd,
    _odd_repeats,
    _order,
    _parted,
    _smaller_group,
    _widest,
    dependence,
    odd_frictions,
    unlike_repeats,
    unlike_runs,
)
from evaluator.diagnosis.likelihood.run_data import RunData

COMMANDS = [(30, 30), (60, 60), (-30, -30), (-60, -60), (33.3, 14.4), (14.4, 33.3), (-33.3, -14.4), (-14.4, -33.3)]


def _experiment(rng: np.random.Generator, drift: float = 0.0) -> tuple[float, str]:
    """Scatter of 20 runs, seen through shares that differ: straight runs tell nothing of friction."""
    data, told = [], []
    for order in range(20):
        left, right = COMMANDS[order % len(COMMANDS)]
        data.append(RunData(str(order), left, right, 0.0, None, np.arange(4) / 2, rng.normal(size=(4, 4)) * 10, order))
        friction = 1e-4 if abs(left) == abs(right) else rng.uniform(0.2, 0.9)
        told.append([friction, *rng.uniform(0.7, 1.0, 3)])
    shares: NDArray[np.float64] = np.array(told)
    true = rng.normal(size=(20, 4)) + drift * np.arange(20)[:, None]
    return _order(shares * true + np.sqrt(shares * (1 - shares)) * rng.normal(size=(20, 4)), shares, data, np.zeros(4))


def test_chance_is_called_something_else_as_seldom_as_said() -> None:
    rng = np.random.default_rng(5)
    probabilities = np.array([_experiment(rng)[0] for _ in range(150)])
    assert np.mean(probabilities < 0.05) <= 0.1
    assert probabilities.min() > 1e-4


def with_friction(friction: NDArray[np.float64]) -> Adequacy:
    """A model whose runs have these frictions, which they determine."""
    effects = np.zeros((len(friction), 4))
    effects[:, 0] = friction
    return Adequacy(1.0, 0.0, np.ones(len(friction)), effects, np.ones(effects.shape), 1.0, "")


def test_scatter_at_the_most_that_is_thought_possible_is_not_chance() -> None:
    """Friction is asked up to 30 %, wheel speed up to 10 %; the values before these are 19 and 6.3 %."""
    order = np.arange(14.0)
    wide = with_friction(0.28 * np.where(order % 3, 1.0, -1.0) * np.where(order % 2, 1.0, -1.0))
    assert _widest(wide, np.array([0.23, 0.078, 0.078, 1.0]), order) == ""
    assert _widest(wide, np.array([0.24, 0.001, 0.001, 1.0]), order).startswith(
        "friction differs from run to run by 24"
    )
    assert _widest(wide, np.array([0.01, 0.081, 0.081, 1.0]), order).startswith(
        "wheel speed differs from run to run by"
    )


@pytest.mark.parametrize("sticky", [0.0, 0.6])
def test_dust_that_gathers_and_a_sticky_run_are_no_implausible_scatter(sticky: float) -> None:
    order = np.arange(14.0)
    friction = -0.06 * order + np.random.default_rng(2).normal(0.0, 0.03, 14)
    friction[0] += sticky
    left = with_friction(friction)
    assert _widest(left, np.array([0.27, 0.001, 0.001, 1.0]), order) == ""
    assert odd_frictions(left, order).tolist() == [bool(sticky)] + [False] * 13
    few = np.arange(7.0)  # too few to tell a line from chance
    assert _widest(with_friction(friction[:7]), np.array([0.27, 0.001, 0.001, 1.0]), few) != ""


def test_frictions_that_scatter_or_change_once_have_no_outliers() -> None:
    order, rng = np.arange(14.0), np.random.default_rng(3)
    odd = [odd_frictions(with_friction(rng.normal(0.0, 0.1, 14)), order).any() for _ in range(200)]
    assert np.mean(odd) < 0.03
    assert not odd_frictions(with_friction(np.where(order > 4, -0.15, 0.0) + rng.normal(0.0, 0.02, 14)), order).any()


def test_what_grows_from_run_to_run_is_not_chance() -> None:
    probability, reason = _experiment(np.random.default_rng(6), drift=0.5)
    assert probability < 1e-6
    assert reason.endswith("order")


def test_what_depends_on_both_coordinates_of_a_place_has_the_p_value_of_analysis_of_variance() -> None:
    """Orthogonal contrasts: friction of 2 x + y and an alternating rest, over places that are crossed four times."""
    x, y, rest = np.repeat([-1.0, 1.0], 8), np.tile([-1.0, -1.0, 1.0, 1.0], 4), np.tile([-1.0, 1.0], 8)
    effects = np.zeros((16, 4))
    effects[:, 0] = 2 * x + y + rest
    marks = [np.tile([a, b + 2, a, b - 2], (2, 1)) for a, b in zip(x, y, strict=True)]
    data = [RunData(str(k), 30, 20, 0.0, None, np.arange(2) / 2, marks[k], 0) for k in range(16)]
    p, reason = _order(effects, np.ones((16, 4)), data, np.zeros(4))
    assert reason == "friction of the runs depends on place"
    assert p == pytest.approx(4 * stats.f.sf((16 * 5 / 2) / (16 / 13), 2, 13))  # of four kinds of random effects


def _left(rng: np.random.Generator, gains: NDArray[np.float64]) -> Adequacy:
    """Runs that tell half or more of friction and gains that scatter by 5 and 0.1 %, left gains changed."""
    told = rng.uniform(0.5, 1.0, (len(gains), 4))
    true = rng.normal(size=(len(gains), 4)) * [0.05, 0.001, 0.001, 1.0]
    true[:, 1] += gains
    return Adequacy(1.0, 0.0, np.ones(len(gains)), np.sqrt(told) * true, told, 1.0, "")


def test_a_wheel_that_is_dirty_for_three_runs_is_told_of_these() -> None:
    gains = np.zeros(20)
    gains[[7, 8, 9]] = 0.015
    (found,) = unlike_runs(_left(np.random.default_rng(3), gains), range(100, 120))
    assert (found.runs, found.what) == ((107, 108, 109), "left_gain")
    assert found.change == pytest.approx(0.015, rel=0.15)


def test_a_mistyped_run_of_three_is_told_although_the_scatter_of_five_runs_includes_it() -> None:
    """Gains that a diagnosis found; the third command was 33.3 / 16.4 rpm, not 33.3 / 14.4."""
    gains = [[0.012, -0.0101], [0.0113, -0.0101], [0.012, 0.1258], [-0.0003, -0.0021], [0.0005, -0.002]]
    effects = np.zeros((5, 4))
    effects[:, 1:3] = gains
    left = Adequacy(1.0, 0.0, np.ones(5), effects, np.ones((5, 4)), 1.0, "")
    commands = [(33.3, 14.4)] * 3 + [(14.4, 33.3)] * 2
    assert unlike_runs(left, range(5)) == []
    (found,) = unlike_repeats(left, (10, 11, 12, 13, 14), commands)
    assert (found.runs, found.what, found.of_command) == ((12,), "right_gain", True)
    assert found.change == pytest.approx(0.1359)
    assert unlike_repeats(left, range(5), [*commands[:2], (33.3, 16.4), *commands[3:]]) == []


def test_a_run_with_a_single_repetition_is_not_judged_by_it() -> None:
    assert _odd_repeats(np.array([0.0, 9.0, 1e-3, 2e-3, 3e-3]), np.array([0, 0, 1, 1, 1]), 1e-3) == {}


def test_repetitions_are_judged_by_the_deviation_from_the_mean_of_the_others() -> None:
    """The probability is that of the externally Studentized residual, computed here without closed forms."""
    labels, values = np.array([0, 0, 0, 0, 1, 1, 2]), np.random.default_rng(2).normal(size=7)
    values[2] += 20.0
    own, other = values[[0, 1, 3]], values[[4, 5]]
    variance = (np.sum((own - own.mean()) ** 2) + np.sum((other - other.mean()) ** 2)) / 3
    deviate = abs(values[2] - own.mean()) / np.sqrt(variance * 4 / 3)
    p = 7 * 2 * stats.t.sf(deviate, 3)
    assert _odd_repeats(values, labels, 1.001 * p) == {2: pytest.approx(values[2] - own.mean())}
    assert _odd_repeats(values, labels, 0.999 * p) == {}


def test_runs_above_and_below_the_others_are_told_apart_with_their_middle() -> None:
    """Of equal runs; each tells another share of its gains, and its estimate is shrunk by that share."""
    true, shares = np.zeros((20, 4)), np.random.default_rng(5).uniform(0.3, 1.0, (20, 4))
    true[:, 2] = 1e-6 * np.resize([1.0, -1.0], 20)
    true[[3, 4, 5], 2] = 0.02, 0.03, 0.07
    true[[8, 9], 2] = -0.05, -0.06
    found = unlike_runs(Adequacy(1.0, 0.0, np.ones(20), np.sqrt(shares) * true, shares, 1.0, ""), range(20))
    assert [(item.runs, item.what) for item in found] == [((3, 4, 5), "right_gain"), ((8, 9), "right_gain")]
    assert [item.change for item in found] == pytest.approx([0.03, -0.055], rel=1e-3)


@pytest.mark.parametrize(
    ("slower", "told"), [((3, 5, 8), (3, 5, 8)), ((0, 1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5)), ((), ())]
)
def test_motors_of_two_speeds_are_two_groups_though_no_run_is_an_outlier(
    slower: tuple[int, ...], told: tuple[int, ...]
) -> None:
    """Three of twelve motors 3 % slower than the others were scatter of all motors, and no word was said of them."""
    gains = np.zeros(12)
    gains[list(slower)] = -0.03
    found = [item for item in unlike_runs(_left(np.random.default_rng(4), gains), range(12)) if item.what != "friction"]
    assert [(item.runs, item.what) for item in found] == ([(told, "left_gain")] if told else [])
    assert [item.change for item in found] == pytest.approx([-0.03] * len(found), rel=0.15)


def test_the_best_two_groups_of_normal_values_are_no_groups_more_often_than_said() -> None:
    rng = np.random.default_rng(6)
    found = sum(bool(_smaller_group(rng.normal(size=8), 0.05)) for _ in range(300))
    assert stats.binom.sf(found - 1, 300, 0.05) > 1e-3
    assert not _smaller_group(np.array([*np.linspace(-1, 1, 10), 2.0, 30.0]), 0.05)  # an outlier and its neighbour
    assert _smaller_group(np.array([0.0, 9.0, 0.1, 9.1, 0.05]), 0.05) == [1, 3]
    assert not _smaller_group(np.array([0.0, 0.1, 9.0]), 1.0)  # one run is no group


def test_the_best_two_groups_are_those_of_a_search_over_all() -> None:
    values = np.sort(np.random.default_rng(7).normal(size=(20, 9)), axis=1)
    ratio, below = _parted(values)
    for row, found, size in zip(values, ratio, below, strict=True):
        within = {k: float(np.var(row[:k]) * k + np.var(row[k:]) * (9 - k)) for k in range(2, 8)}
        best = min(within, key=lambda k: within[k])
        assert (size, found) == (best, pytest.approx(np.var(row) * 9 / within[best] - 1))


@pytest.mark.parametrize(("off", "unlike"), [(-0.02, ()), (0.02, (19,))])
def test_a_run_is_unlike_the_others_beyond_what_chance_gives_in_one_of_a_thousand_experiments(
    off: float, unlike: tuple[int, ...]
) -> None:
    """The limit of Grubbs (1969) for one of 20 runs, in one of three quantities: friction, left and right speed."""
    t = stats.t.isf(1e-3 / 3 / (2 * 20), 18)
    limit = 19 / np.sqrt(20) * np.sqrt(t**2 / (18 + t**2)) + off
    others = stats.norm.ppf((np.arange(19) + 0.5) / 19)

    def beyond(value: float) -> float:
        values = np.append(others, value)
        return float((value - values.mean()) / values.std(ddof=1) - limit)

    gains = np.append(others, optimize.brentq(beyond, 1.0, 1e3)) * 1e-3
    effects, shares = np.tile(others.mean(), (20, 4)), np.full((20, 4), 0.25)
    effects[:, 1] = 0.5 * gains
    found = unlike_runs(Adequacy(1.0, 0.0, np.ones(20), effects, shares, 1.0, ""), range(20))
    assert sum((item.runs for item in found), ()) == unlike


# The data with which Rosner's test is explained in the NIST/SEMATECH e-Handbook of Statistical Methods, 1.3.5.17.3.
ROSNER = [
    *(-0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69, 1.70),
    *(1.76, 1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40),
    *(2.47, 2.54, 2.62, 2.64, 2.90, 2.92, 2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01),
]


def test_three_outliers_of_the_published_example_are_found_though_the_first_alone_would_not_be() -> None:
    values = np.array(ROSNER)
    assert sorted(_odd(values, 0.05)) == [51, 52, 53]
    assert sorted(_odd(-values[::-1], 0.05)) == [0, 1, 2]
    assert _odd(values[:51], 0.05) == []


@pytest.mark.parametrize(("count", "critical"), [(10, 2.290), (20, 2.709), (30, 2.908)])
@pytest.mark.parametrize(("off", "odd"), [(-0.01, False), (0.01, True)])
def test_one_value_is_odd_beyond_the_tabled_two_sided_limit_of_grubbs(
    count: int, critical: float, off: float, odd: bool
) -> None:
    """Critical values of Grubbs (1969), Technometrics 11, 1, at 5 %."""
    others = stats.norm.ppf((np.arange(count - 1) + 0.5) / (count - 1))

    def deviate(value: float) -> float:
        values = np.append(others, value)
        return float((value - values.mean()) / values.std(ddof=1))

    value = optimize.brentq(lambda at: deviate(at) - critical - off, 1.0, 1e3)
    assert _odd(np.append(others, value), 0.05) == ([count - 1] if odd else [])


@pytest.mark.parametrize(("count", "far", "found"), [(6, 1, 0), (7, 1, 1), (8, 2, 2), (11, 3, 0), (12, 3, 3)])
def test_of_seven_runs_and_more_a_quarter_may_be_odd(count: int, far: int, found: int) -> None:
    """Of a third that are far, each hides the others, and which are the odd ones is not clear."""
    values = 1e-3 * np.resize([1.0, -1.0], count)
    values[:far] += 100.0 + np.arange(far)
    assert sorted(_odd(values, 0.05)) == list(range(found))


def test_of_parts_of_recordings_only_differences_within_one_count() -> None:
    """Six recordings of five parts, each with a clock of its own, and a place."""
    rng = np.random.default_rng(5)
    recordings = np.repeat(np.arange(6), 5)
    clock, place = rng.normal(size=6)[recordings], rng.normal(size=6)[recordings]
    late = 0.9 * place + 0.1 * clock + 0.1 * rng.normal(size=30)
    own, every = (place + 0.1 * rng.normal(size=30))[:, None], np.ones(30)
    assert dependence(late, every, own)[0] < 1e-6
    assert dependence(late, every, own, recordings)[0] > 1e-3
    assert np.isnan(dependence(late, every, place[:, None], recordings)[0])  # the same in all parts
    side = rng.choice([-1.0, 1.0], size=30)
    p, size = dependence(late + side, every, side[:, None], recordings)
    assert p < 1e-6
    assert size == pytest.approx(1.0, abs=0.1)
    assert dependence(late, every, own, np.arange(30)) == dependence(late, every, own)  # whole runs
