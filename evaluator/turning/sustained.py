"""The smallest turning radius that a run sustains, without the bias of a minimum over noisy windows.

Sustained means: held over at least a quarter turn of heading. The run is cut into quarter turns, or into four pieces if
it has fewer; each has a curvature with its own uncertainty. If these differ by no more than their uncertainties explain
(Cochran 1954, doi:10.2307/3001666), the run has one radius, and the smallest sustained one is that of the whole run: no
minimum is taken, so that noise cannot make it smaller. If they differ, they are a population with a spread (Paule and
Mandel 1982, doi:10.6028/jres.087.022). Windows of a quarter turn are then slid along the run; each value is shrunk
toward the mean by the share of its difference that noise explains, and the tightest one is the result: a posterior
mean, which is not biased by choosing the largest (Dawid 1994, doi:10.1214/lnms/1215463797). The radius of a window is
its path length per angle turned, whether its curvature changes or not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.turning.motion.curvature import Z_975, Curvature
from evaluator.turning.motion.fit import FEWEST_FRAMES, Scaled, TurnFit, fit_turns
from evaluator.turning.pooling import cochran, paule_mandel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A once-per-turn variation of the radius (tilt, gradient) keeps sin(45°)/45° = 90 % of its amplitude over a quarter
# turn.
QUARTER_TURN_RAD = np.pi / 2
# Probability with which a run of one radius is taken for a varying one.
FALSE_ALARM = 1e-3
# Pieces in which a change of curvature is looked for: four show changes in one direction, and changes there and back.
FEWEST_PIECES = 4
# If the curvature changes much inside a piece, the residual of its circle counts as noise and hides the change from
# piece to piece. The residual falls with the cube of the length, so that pieces of a quarter of it show the change.
FINER = (1, 2, 4)
# A fit that rejects more than a tenth of the frames takes a bend for jumps; jumps are then looked for in pieces
# instead.
FEWEST_USED = 0.9
LEAST_SHARE = 1e-6  # relative uncertainty of any length; without it, rounding would make a simulated circle vary
STEADY = 1  # index of the steady turn among the regions
# Quarter turns are slid in steps of half a quarter, then around the tightest one in steps of an eighth. At 11 degrees
# from the tightest window, a curvature that changes there and back has changed the mean by less than 2 % of the change.
COARSE, FINE = 0.5, 0.125
# The change of curvature inside a window is estimated to first order. The remainder is of second order in the share c
# of the turn that is due to the change; c² is an upper bound for ellipses and spirals (tests).
SECOND_ORDER = 1.0


@dataclass(frozen=True)
class Sustained:
    """Quarter turns of a run.

    tightest: curvature of the tightest sustained stretch; mean: of all. varies: whether they differ beyond their
    uncertainties; spread_per_mm: standard deviation of the curvature between them, noise subtracted. p_value: of equal
    radii. from_s, to_s: the tightest stretch. wander_mm: RMS displacement of the centre of rotation between quarter
    turns, noise subtracted.
    """

    tightest: Curvature
    mean: Curvature
    varies: bool
    spread_per_mm: float
    p_value: float
    from_s: float
    to_s: float
    wander_mm: float = float("nan")


def sustained_turn(time_s: Array, scaled: Scaled, regions: list[Flags], whole: TurnFit) -> Sustained:
    """Find the minimum sustained radius.

    regions: stretches of frames, (n,) each, before, in and after the steady turn. whole: fit to the steady turn, the
    result if nothing varies.
    """
    steady, heading = whole.curvature(), scaled.pose[:, 2]
    same = Sustained(steady, steady, varies=False, spread_per_mm=0.0, p_value=1.0, from_s=time_s[0], to_s=time_s[-1])
    regions = list(regions)
    if whole.used.mean() > FEWEST_USED:  # outliers would have a large weight in a short window
        regions[STEADY] = _only(regions[STEADY], whole.used)
    tests: list[_Pieces] = []
    for finer in FINER:
        pieces = _pieces(heading, regions, finer)
        if len(pieces) <= (len(tests[-1].fits) if tests else 1):
            continue
        tests.append(_one_curvature(fit_turns(time_s, scaled, pieces)))
        if len(tests) == 1:
            regions = [region & ~_jumping(pieces, tests[0].fits) for region in regions]
    if not tests:
        return same
    same = replace(same, wander_mm=_wander(tests[0].fits))
    test = min(tests, key=lambda test: test.p_value)
    p_value = min(len(tests) * test.p_value, 1.0)
    if p_value > FALSE_ALARM:
        return replace(same, p_value=p_value)
    values, sigmas = test.values, test.sigmas
    between = paule_mandel(values, sigmas)
    center = _mean_of(values, sigmas, between)
    sense = np.sign(center.value) or 1.0
    windows, found = _tightest(time_s, scaled, np.any(regions, axis=0), sense, center, between)
    if found is None:
        # No quarter turn was held: the result is that of the whole, with the change of its curvature as uncertainty.
        windows, found = regions[STEADY], steady.with_systematic(between)
    # The camera's error is common to the whole run: a share of the curvature of every stretch.
    share = abs(steady.systematic / steady.value) if steady.value else 0.0
    when = time_s[windows]
    return Sustained(
        found.with_systematic(share * abs(found.value)),
        center.with_systematic(share * abs(center.value)),
        varies=True,
        spread_per_mm=between,
        p_value=p_value,
        from_s=float(when[0]),
        to_s=float(when[-1]),
        wander_mm=same.wander_mm,
    )


@dataclass(frozen=True)
class _Pieces:
    """Curvatures of pieces of a run, and the probability of such differences if it has one curvature."""

    fits: list[TurnFit]
    values: Array
    sigmas: Array
    p_value: float


def _one_curvature(fits: list[TurnFit]) -> _Pieces:
    curvatures = [fit.curvature() for fit in fits]
    values, sigmas = np.array([c.value for c in curvatures]), np.array([_known_to(c) for c in curvatures])
    return _Pieces(fits, values, sigmas, float(special.chdtrc(len(values) - 1, cochran(values, sigmas, 0.0))))


def _only(region: Flags, used: Flags) -> Flags:
    """The frames of a region that a fit to it has used."""
    result = region.copy()
    result[region] = used
    return result


def _jumping(pieces: list[Flags], fits: list[TurnFit]) -> Flags:
    """Frames, (n,), that the fits to pieces have rejected."""
    result = np.zeros(len(pieces[0]), dtype=bool)
    for piece, fit in zip(pieces, fits, strict=True):
        result[np.flatnonzero(piece)[~fit.used]] = True
    return result


def _pieces(heading_rad: Array, regions: list[Flags], finer: int) -> list[Flags]:
    """Cut regions into equal turns: quarter turns, the steady region into at least FEWEST_PIECES; finer: into more.

    Before and after the steady turn, only complete quarter turns are used.
    """
    windows = []
    for index, region in enumerate(regions):
        inside = np.flatnonzero(region)
        if len(inside) < FEWEST_FRAMES:
            continue
        turned, most = heading_rad[inside[-1]] - heading_rad[inside[0]], len(inside) // (2 * FEWEST_FRAMES)
        count = int(abs(turned) / QUARTER_TURN_RAD + 1e-6)
        if index == STEADY:
            count = max(count, FEWEST_PIECES)
        count = min(finer * count, most)
        if count and turned:
            shares = [(number / count, (number + 1) / count) for number in range(count)]
            windows += _between(heading_rad, inside, shares)
    return windows


def _between(heading_rad: Array, inside: NDArray[np.intp], shares: list[tuple[float, float]]) -> list[Flags]:
    """Frames of `inside` between shares of its turn; windows with too few frames are omitted."""
    turned = heading_rad[inside] - heading_rad[inside[0]]
    share = np.clip(turned / turned[-1], 0, 1)
    windows = []
    for low, high in shares:
        window = np.zeros(len(heading_rad), dtype=bool)
        window[inside[(share >= low) & (share <= high)]] = True
        if window.sum() >= FEWEST_FRAMES:
            windows.append(window)
    return windows


def _tightest(
    time_s: Array, scaled: Scaled, moving: Flags, sense: float, center: Curvature, between: float
) -> tuple[Flags, Curvature | None]:
    """Tightest window of a quarter turn and its curvature; no curvature if the run has no quarter turn."""
    heading, inside = scaled.pose[:, 2], np.flatnonzero(moving)
    turned = abs(heading[inside[-1]] - heading[inside[0]])
    width = QUARTER_TURN_RAD / turned if turned else np.inf
    if width > 1:
        return moving, None
    starts = np.linspace(0, 1 - width, int(np.ceil((1 - width) / (COARSE * width))) + 1)
    best: tuple[float, Flags, Curvature] | None = None
    for _ in ("coarse", "fine"):
        windows = _between(heading, inside, [(start, start + width) for start in starts])
        if len(windows) < len(starts):
            return moving, None  # too few frames in a quarter turn
        fits = fit_turns(time_s, scaled, windows, bending=True)
        shrunk = [_shrunk(_with_change(fit), center, between) for fit in fits]
        chosen = int(np.argmax([sense * curvature.value for curvature in shrunk]))
        if best is None or sense * shrunk[chosen].value > best[0]:
            best = (sense * shrunk[chosen].value, windows[chosen], shrunk[chosen])
        steps = width * FINE * np.arange(1 - COARSE / FINE, COARSE / FINE)
        starts = np.unique(np.clip(starts[chosen] + steps, 0, 1 - width))
    assert best is not None  # the first round has a window
    return best[1], best[2]


def _with_change(fit: TurnFit) -> Curvature:
    """Mean curvature of a window, with bounds widened by the uncertainty due to its change inside the window."""
    circle = fit.curvature()
    uneven = SECOND_ORDER * float(fit.change_rad @ fit.change_rad) / max(fit.motion.turn_rad, 1e-9) ** 2
    return circle.with_systematic(uneven * abs(circle.value) / Z_975)


def _wander(fits: list[TurnFit]) -> float:
    """RMS distance of the quarter turns' centres of rotation from their mean, noise subtracted."""
    centers, covariances = zip(*(fit.center_mm() for fit in fits), strict=True)
    places = np.array(centers)
    spread = float(((places - places.mean(axis=0)) ** 2).sum() / (len(places) - 1))
    noise = float(np.mean([np.trace(covariance) for covariance in covariances]))
    return float(np.sqrt(max(spread - noise, 0.0)))


def _known_to(one: Curvature) -> float:
    """Standard uncertainty of a quarter turn, including errors of camera and marks, which vary between turns."""
    return float(np.linalg.norm([one.sigma, one.systematic, LEAST_SHARE * one.value]))


def _mean_of(values: Array, sigmas: Array, between: float) -> Curvature:
    weight = 1 / (sigmas**2 + between**2)
    value, sigma = float(weight @ values / weight.sum()), float(np.sqrt(1 / weight.sum()))
    reach = float(special.stdtrit(len(values) - 1, 0.975)) * sigma
    return Curvature(value, value - reach, value + reach, sigma)


def _shrunk(one: Curvature, center: Curvature, between: float) -> Curvature:
    """Posterior of a quarter turn's curvature, given the population of quarter turns."""
    keep = between**2 / (between**2 + _known_to(one) ** 2)
    value = center.value + keep * (one.value - center.value)
    sigma = float(np.sqrt(keep * _known_to(one) ** 2 + ((1 - keep) * center.sigma) ** 2))
    return Curvature(value, value - Z_975 * sigma, value + Z_975 * sigma, sigma)
