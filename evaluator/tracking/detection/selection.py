"""Selection of the marks among coloured blobs, by colour, roundness, size and distance of a pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.settings import MarkSettings, TrackingSettings

Array = NDArray[np.float64]
# Spread of the logarithm of a pair's distance in diameters: for one robot, measured from coloured blobs; for all
# robots.
SAID, OTHER = 0.05, 0.2
USUAL, ANY_ROBOT = 3.0, 1.0  # default distance in diameters, and the spread of its logarithm
TOUCHING = 1.0  # diameters: nearer pairs (halves of one square) gain nothing over this distance
CUT = -4.0  # log odds of a mark that is cut by the border of the image, as floors and walls often are
OBLONG = -2.0  # log odds of a mark that is a sticker of any shape instead of a disc
OVERLAPPING = 20.0  # penalty of two blobs whose centres are within one of them: one object at two levels of chroma
# Difference of log-likelihoods of two pairs with equal geometry, by 2 % uncertainty of blobs (0.1) and light that
# varies by 10 % (0.4).
ALIKE = 0.7


@dataclass(frozen=True)
class Candidate:
    """A coloured blob.

    center_px: (x, y); radius_px: of the disc of equal area; chroma_uv: mean (u, v) of its core. whole: not cut by the
    border of the image.
    """

    mark: str
    center_px: tuple[float, float]
    radius_px: float
    elongation: float
    chroma: float
    chroma_uv: tuple[float, float]
    whole: bool = True


def choose(found: list[Candidate], settings: TrackingSettings) -> tuple[dict[str, Candidate], float]:
    """Choose a candidate for each mark: the best pair if two marks of one body are searched, else the best of each.

    Returns them with their log-likelihood, up to a constant.
    """
    by_mark = {name: [one for one in found if one.mark == name] for name in settings.mark}
    strongest = max((one.chroma for one in found), default=1.0)
    if settings.pair and all(by_mark[name] for name in settings.pair):
        ones, others = (by_mark[name] for name in settings.pair)
        scores = _pair_scores(ones, others, settings, strongest)
        best = divmod(int(np.argmax(scores)), len(others))
        return {ones[best[0]].mark: ones[best[0]], others[best[1]].mark: others[best[1]]}, float(scores[best])
    chosen: dict[str, Candidate] = {}
    total = 0.0
    for name, ones in by_mark.items():
        free = [one for one in ones if not any(_same_place(one, other) for other in chosen.values())]
        if free:
            own = [_own_score(one, settings.mark[name], strongest) for one in free]
            chosen[name] = free[int(np.argmax(own))]
            total += max(own)
    return chosen, total


def _same_place(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are the same blob, which two marks of one colour must not share."""
    return float(np.hypot(*np.subtract(one.center_px, other.center_px))) < max(one.radius_px, other.radius_px)


def alike(found: list[Candidate], settings: TrackingSettings) -> list[dict[str, Candidate]]:
    """Pairs of the two marks that share no blob and are about as probable as the best one, which comes first."""
    first, second = settings.pair
    ones, others = ([one for one in found if one.mark == name] for name in settings.pair)
    scores = _pair_scores(ones, others, settings, max((one.chroma for one in found), default=1.0))
    near, chosen = np.argwhere(scores >= scores.max(initial=-np.inf) - ALIKE), list[dict[str, Candidate]]()
    for i, j in sorted(near, key=lambda at: -scores[*at]):
        one, other = ones[i], others[j]
        if all(one is not pair[first] and other is not pair[second] for pair in chosen) and not any(
            _same_place(one, pair[second]) and _same_place(other, pair[first]) for pair in chosen
        ):  # exchanged marks of one colour are the same pair
            chosen.append({first: one, second: other})
    return chosen


def _own_score(one: Candidate, mark: MarkSettings, strongest: float) -> float:
    """Log-likelihood, up to a constant, that a blob is a mark; spreads are those of real marks."""
    round_or_not = np.logaddexp(-0.5 * (np.log(one.elongation) / 0.3) ** 2, OBLONG)
    score = round_or_not + 2.0 * np.log(one.chroma / strongest) + CUT * (not one.whole)
    if mark.diameter_px is not None:
        score -= 0.5 * (np.log(2 * one.radius_px / mark.diameter_px) / 0.15) ** 2
    elif one.radius_px > 3:
        return float(score)
    else:
        score -= 0.5 * ((3 - one.radius_px) / 1.0) ** 2
    return float(score)


def shortlist(found: list[Candidate], settings: TrackingSettings, most: int) -> list[Candidate]:
    """Blobs to examine: first the most colourful ones for each mark, then those of the most probable pairs.

    most: of either kind, per mark. By colour alone, marks would be missed beside more colourful objects with many
    parts, such as text that a camera writes into its frames.
    """
    by_mark = [[one for one in found if one.mark == name] for name in settings.pair or settings.mark]
    ranked = [sorted(blobs, key=lambda blob: -blob.chroma * min(blob.radius_px, 3.0)) for blobs in by_mark]
    kept = {id(one) for blobs in ranked for one in blobs[:most]}
    if settings.pair and all(by_mark):
        ones, others = by_mark
        scores = _pair_scores(ones, others, settings, max(one.chroma for one in found))
        for blobs, of_best_pair in zip((ones, others), (scores.max(axis=1), scores.max(axis=0)), strict=True):
            kept |= {id(blobs[k]) for k in np.argsort(-of_best_pair)[:most]}
    return [one for blobs in ranked for one in blobs if id(one) in kept]


def _pair_scores(ones: list[Candidate], others: list[Candidate], settings: TrackingSettings, strongest: float) -> Array:
    """Log-likelihoods (n, m) that two blobs are the marks of one robot: equal size, known distance in diameters.

    ones, others: of the two marks of settings.pair, in its order.
    """
    own = [np.array([_own_score(one, settings.mark[one.mark], strongest) for one in blobs]) for blobs in (ones, others)]
    radius = [np.array([one.radius_px for one in blobs]) for blobs in (ones, others)]
    place = [np.array([one.center_px for one in blobs]).reshape(-1, 2) for blobs in (ones, others)]
    score = own[0][:, None] + own[1] - 0.5 * (np.log(radius[0][:, None] / radius[1]) / 0.15) ** 2
    distance = np.hypot(*np.moveaxis(place[0][:, None] - place[1], -1, 0))
    diameters = np.maximum(distance / (radius[0][:, None] + radius[1]), 1e-3)
    if settings.pair_distance is not None:
        score += _log_odds(np.log(diameters / settings.pair_distance))
    elif settings.distance_diameters is not None:  # by default, the marks of a robot are some diameters apart
        score -= 0.5 * (np.log(diameters / USUAL) / ANY_ROBOT) ** 2
        # Marks of other robots lie anywhere: their number grows with the area, so that near ones are more telling.
        score -= 2.0 * np.log(np.maximum(diameters, TOUCHING) / USUAL)
        score -= OVERLAPPING * (distance < np.maximum(radius[0][:, None], radius[1]))
    return np.asarray(score, float)


def _log_odds(off: Array) -> Array:
    """Log-likelihood, up to a constant, of the logarithm of a pair's distance over the expected one.

    A mixture: the stated robot, or another one with a similar distance; the latter bounds the penalty.
    """
    said, other = np.exp(-0.5 * (off / SAID) ** 2) / SAID, np.exp(-np.minimum(0.5 * (off / OTHER) ** 2, 20.0)) / OTHER
    return np.asarray(np.log(said + other) - np.log(1.0 / SAID + 1.0 / OTHER))
