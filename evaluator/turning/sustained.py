"""The smallest turning radius that a run sustains, without the bias of a minimum over noisy windows.

Sustained means: held over at least a quarter turn of heading. The run is cut into quarter turns (and again, shifted by
half of one); each has a curvature with its own uncertainty. If these differ by no more than their uncertainties explain
(Cochran 1954, doi:10.2307/3001666), the run has one radius, and the smallest sustained one is that of the whole: no
minimum is taken, so noise cannot make it smaller. If they differ, they are a population of their own spread (Paule and
Mandel 1982, doi:10.6028/jres.087.022), each value is shrunk toward the mean by the share of its difference that noise
would explain, and the tightest is the answer: a posterior mean, which choosing the largest does not bias (Dawid 1994,
doi:10.1214/lnms/1215463797).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.turning.motion.fit import FEWEST_FRAMES, Curvature, Scaled, TurnFit, fit_turns
from evaluator.turning.pooling import cochran, paule_mandel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A once-per-turn variation of the radius (tilt, gradient) keeps sin(45°)/45° = 90 % of its amplitude over a quarter
# turn.
QUARTER_TURN_RAD = np.pi / 2
# A run of one radius is taken for a varying one this often.
FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class Sustained:
    """Quarter turns of a run.

    tightest: curvature of the tightest sustained stretch; mean: of all. varies: whether they differ beyond their
    uncertainties; spread_per_mm: standard deviation of the curvature between them, noise taken off. p_value of one
    radius. from_s, to_s: the tightest stretch. wander_mm: how far the centre of rotation strays between quarter turns,
    noise taken off.
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
    """Find the smallest sustained radius.

    regions: stretches of frames, (n,) each, cut into quarter turns one by one. whole: fit to the steady turn, the
    answer where nothing varies.
    """
    steady = whole.curvature()
    first = [window for region in regions for window in _quarter_turns(scaled.pose[:, 2], region, 0.0)]
    same = Sustained(steady, steady, varies=False, spread_per_mm=0.0, p_value=1.0, from_s=time_s[0], to_s=time_s[-1])
    if len(first) < 2:
        return same
    fits = fit_turns(time_s, scaled, first)
    same = replace(same, wander_mm=_wander(fits))
    curvatures = [fit.curvature() for fit in fits]
    values, sigmas = np.array([c.value for c in curvatures]), np.array([_known_to(c) for c in curvatures])
    p_value = float(special.chdtrc(len(values) - 1, cochran(values, sigmas, 0.0)))
    if p_value > FALSE_ALARM:
        return replace(same, p_value=p_value)
    between = paule_mandel(values, sigmas)
    center = _mean_of(values, sigmas, between)
    shifted = [window for region in regions for window in _quarter_turns(scaled.pose[:, 2], region, 0.5)]
    windows = first + shifted
    curvatures += [fit.curvature() for fit in fit_turns(time_s, scaled, shifted)] if shifted else []
    shrunk = [_shrunk(curvature, center, between) for curvature in curvatures]
    # The camera's error is common to the whole run: a share of the curvature, whichever stretch it is of.
    share = abs(steady.systematic / steady.value) if steady.value else 0.0
    shrunk = [curvature.with_systematic(share * abs(curvature.value)) for curvature in shrunk]
    center = center.with_systematic(share * abs(center.value))
    sense = np.sign(center.value) or 1.0
    best = int(np.argmax([sense * curvature.value for curvature in shrunk]))
    when = time_s[windows[best]]
    return Sustained(
        shrunk[best],
        center,
        varies=True,
        spread_per_mm=between,
        p_value=p_value,
        from_s=float(when[0]),
        to_s=float(when[-1]),
        wander_mm=same.wander_mm,
    )


def _quarter_turns(heading_rad: Array, region: Flags, shift: float) -> list[Flags]:
    """Cut a region into equal windows of at least a quarter turn; shifted ones leave half a window at either end."""
    inside = np.flatnonzero(region)
    if len(inside) < FEWEST_FRAMES:
        return []
    turned = heading_rad[inside] - heading_rad[inside[0]]
    total = turned[-1]
    count = min(int(abs(total) / QUARTER_TURN_RAD + 1e-6), len(inside) // (2 * FEWEST_FRAMES))
    if count < 1 or (shift and count < 2):
        return []
    index = np.floor(turned / total * count - shift)
    if not shift:
        index = np.clip(index, 0, count - 1)
    windows = []
    for number in range(count - (1 if shift else 0)):
        window = np.zeros(len(heading_rad), dtype=bool)
        window[inside[index == number]] = True
        if window.sum() >= FEWEST_FRAMES:
            windows.append(window)
    return windows


def _wander(fits: list[TurnFit]) -> float:
    """RMS distance of the quarter turns' centres of rotation from their mean, what noise explains taken off."""
    centers, covariances = zip(*(fit.center_mm() for fit in fits), strict=True)
    places = np.array(centers)
    spread = float(((places - places.mean(axis=0)) ** 2).sum() / (len(places) - 1))
    noise = float(np.mean([np.trace(covariance) for covariance in covariances]))
    return float(np.sqrt(max(spread - noise, 0.0)))


def _known_to(one: Curvature) -> float:
    """Standard uncertainty of a quarter turn: errors of the camera and the marks differ from one to the next too."""
    return float(np.hypot(one.sigma, one.systematic))


def _mean_of(values: Array, sigmas: Array, between: float) -> Curvature:
    weight = 1 / (sigmas**2 + between**2)
    value, sigma = float(weight @ values / weight.sum()), float(np.sqrt(1 / weight.sum()))
    reach = float(special.stdtrit(len(values) - 1, 0.975)) * sigma
    return Curvature(value, value - reach, value + reach, sigma)


def _shrunk(one: Curvature, center: Curvature, between: float) -> Curvature:
    """Posterior of a quarter turn's curvature given the population it belongs to."""
    keep = between**2 / (between**2 + _known_to(one) ** 2)
    value = center.value + keep * (one.value - center.value)
    sigma = float(np.sqrt(keep * _known_to(one) ** 2 + ((1 - keep) * center.sigma) ** 2))
    return Curvature(value, value - 1.96 * sigma, value + 1.96 * sigma, sigma)
