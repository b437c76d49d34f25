"""Numbers that stand for a probability: each is what the comment beside it states, under the law that it names."""

import math

import pytest
from scipy import stats

from calibration.assessment.camera_check import ALARM_SIGMA
from evaluator import robust
from evaluator.diagnosis.assessment import gap, knowledge, model_comparison, verdict
from evaluator.diagnosis.assessment.residuals import disagreeing_runs, disagreement
from evaluator.diagnosis.assessment.residuals.unexplained import LAID_ON
from evaluator.diagnosis.design.next_runs import RIVAL_PROBABILITY
from evaluator.diagnosis.likelihood.noise import discrepancy, spectrum
from evaluator.interchange.poses import MEDIAN_OF_CHI2
from evaluator.tracking.refinement import edge, fast_path, occlusion, slow_path
from evaluator.tracking.uncertainty import rim
from evaluator.turning import clock, path
from evaluator.turning.motion import curvature, fit


def beyond(sigmas: float) -> float:
    """Probability that a normal number is farther from its mean, on either side."""
    return float(2 * stats.norm.sf(sigmas))


STRAINS = stats.binom(25, beyond(knowledge.FINDING_SIGMAS))  # values of a laboratory that are that far off
STATED = {
    # medians and quantiles, to their digits
    "sigma of a median deviation": (robust.PER_MEDIAN, 1 / stats.norm.ppf(0.75), 1e-5),
    "median of two channels": (fit.MEDIAN_SQUARED, stats.chi2.median(2), 1e-3),
    "median of a parabola's residuals": (MEDIAN_OF_CHI2[6], stats.chi2.median(6), 1e-4),
    "median of a mode's power": (spectrum.MEDIAN_OF_POWER, stats.chi2.median(1), 1e-4),
    "median of three slow modes": (discrepancy.MEDIAN_OVER_MEAN, stats.chi2.median(3) / 3, 5e-3),
    "95 % of one parameter": (clock.CHI2_95, stats.chi2.isf(0.05, 1), 1e-3),
    "95 % on both sides": (curvature.Z_975, stats.norm.ppf(0.975), 1e-3),
    "quantiles of 95 %": (fit.COVERED[1] - fit.COVERED[0], 0.95, 1e-9),
    # chances, to the digits of the words
    "a rise time": (stats.chi2.sf(clock.WORTH, 1), 1e-3, 0.03),
    "a frame off its neighbours": (stats.chi2.sf(fit.OUTLIER_SQUARED, 2), 1e-6, 0.03),
    "a jump of a path": (beyond(path.JUMP_SIGMA), 1 / 5e8, 0.03),
    "wander of a run": (beyond(gap.OF_WANDER), 1 / 16_000, 0.03),
    "a value that is told": (beyond(knowledge.FINDING_SIGMAS), 1 / 370, 0.01),
    "one value of a laboratory": (STRAINS.sf(0), 1 / 15, 0.05),
    "as many values as strain it": (STRAINS.sf(verdict.STRAINED - 1), 1 / 500, 0.2),
    "a phase that disagrees": (24 * 2 * 3 * beyond(disagreeing_runs.DISAGREES_SIGMAS), 1 / 15, 0.05),
    "a dependence that is shown": (57 * beyond(disagreement.SHOWN_SIGMAS), 1 / 40, 0.1),
    "two alike effects": (stats.norm.sf(model_comparison.SAME_SIGMAS / 2), 0.02, 0.2),
    "a rival": (RIVAL_PROBABILITY, 0.02, 1e-9),
    "an alarm of a camera": (beyond(ALARM_SIGMA), 1 / 16_000, 0.03),
    "a disturbed rim": (stats.chi2.sf(rim.ODD * rim.SQUARES, rim.SQUARES), 0.01, 0.05),
    "a rim that is not round": (stats.f.sf(3 * rim.ANGULAR - 2, 2, 4), 0.03, 0.1),  # all are the even and two odd ones
    "an edge": (stats.chi2.sf(edge.CLEARLY, 4), 1 / 2000, 0.02),
    "two slopes": (stats.chi2.sf(occlusion.SLOPING, 2), 1 / 400, 0.02),
    "calmer residuals": (stats.chi2.sf(fast_path.CALMER * 100, 100), 0.98, 0.02),
    # odds, and ratios that follow from a formula
    "odds of an effect": (math.exp(verdict.KEEP[0]), 3000.0, 0.01),
    "odds of a relieving effect": (math.exp(verdict.RELIEVING), 400.0, 0.01),
    "rate after a fitted start": (LAID_ON**2, 1 / 3 - 1 / 4, 1e-9),
    "an edge that is neglected": (math.hypot(1, slow_path.NEGLIGIBLE), 1 + 1 / 8, 0.01),
    "few squares": (rim.FEW_SQUARES, rim.SQUARES * stats.invgamma(rim.SQUARES / 2, scale=0.5).mean(), 1e-9),
}


@pytest.mark.parametrize("name", STATED)
def test_a_number_is_what_is_stated_beside_it(name: str) -> None:
    """Halved or doubled, none is."""
    number, stated, within = STATED[name]
    assert number == pytest.approx(stated, rel=within)
