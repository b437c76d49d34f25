"""Common shape of the two marks of a robot, which are equal discs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from evaluator.tracking.detection.appearance import Appearance, with_disc
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.motion import Motion
from evaluator.tracking.refinement.disc import shaped_as

# Largest differences of two equal marks:
UNEQUAL = 0.08  # relative, of their radii: halation of a brighter mark, learning from noisy frames
UNEQUAL_NOISE = 4.0  # ratio of their noise, because they have the same light and codec
UNEQUAL_SLANT = 0.02  # of their slants: an occluded rim looks slanted on one mark only
MORE_OCCLUDED = 0.05  # difference in occluded information from which the partner's shape is more reliable
DAZZLED = 2.0  # ratio of noise over squared contrast of two marks; a difference of their colours alone causes less


def agree(followers: Mapping[str, Motion], pair: Sequence[str], take: Callable[[Follower, Appearance], None]) -> None:
    """Give both marks of a robot the same shape if one of them was partly hidden, since they are equal discs."""
    marks = [mark for name in sorted(pair) if isinstance(mark := followers.get(name), Follower)]
    if not pair or len(marks) < len(pair):
        return
    better, worse = sorted(marks, key=lambda mark: mark.look.disc.occluded)
    if worse.look.disc.occluded > better.look.disc.occluded + MORE_OCCLUDED:
        take(worse, with_disc(worse.look, shaped_as(worse.look.disc, better.look.disc)))
        return
    worse, better = sorted(marks, key=lambda mark: mark.radius_px)
    if worse.radius_px < (1 - UNEQUAL) * better.radius_px:
        # An occlusion makes a mark smaller; glare reduces its contrast and makes it larger.
        if better.look.disc.unclear > DAZZLED * worse.look.disc.unclear:
            worse, better = better, worse
    else:
        better, worse = sorted(marks, key=lambda mark: mark.look.disc.noise)
        alike = worse.look.disc.unlike(better.look.disc) < UNEQUAL_SLANT
        if alike and worse.look.disc.noise < UNEQUAL_NOISE * better.look.disc.noise:
            return
    take(worse, with_disc(worse.look, shaped_as(worse.look.disc, better.look.disc)))
