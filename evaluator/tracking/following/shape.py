"""Decision whether a mark is a disc, from the first frames that show it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from evaluator.recording import Frame
from evaluator.tracking.detection.appearance import learn_color, patch_of, with_disc
from evaluator.tracking.detection.color_map import allowed_cells, neutral_of
from evaluator.tracking.detection.find import candidates
from evaluator.tracking.detection.lookalikes import RESTING_PX, Rivals, mover
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.following.equal_discs import agree
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import NEARBY, Array, BlobFollower, start_blob
from evaluator.tracking.observation import OK, REPEATED, Sighting
from evaluator.tracking.refinement.blob import OTHER_HUE, elongation
from evaluator.tracking.refinement.learn_shape import finished
from evaluator.tracking.settings import TrackingSettings

Held = tuple[Frame, list[Sighting]]
Followers = dict[str, Follower | BlobFollower]
Starts = dict[str, tuple[int, BlobFollower]]  # by mark: index of the first frame, and the blob that was found in it
Tried = tuple[BlobFollower, list[Sighting]] | None  # a follower after some frames, and its measurements in them

# A disc at 45 degrees is 1.41 times as long as wide; a larger elongation is significant motion blur.
OBLONG = 1.45
SHUTTERS = (0.0, 0.25, 0.5, 0.75, 1.0)  # exposures, as shares of the interval, tried for motion blur
FEW = 3  # frames needed for a decision
# Share of the frames with the blob in which a disc must be found, and of those with the disc in which the blob must be:
# a blob is followed from its start, and lost if it moves by several radii a frame.
SELDOM = 0.5
# Number of consecutive frames in which a mark differs from its disc, and ratio of its area to that of the disc, from
# which it is seen in another view.
UNLIKE, SMALLER = 6, 0.7
# Variance of the colour's centroid over that of the disc in the luma, both from the scatter of pixels, below which the
# mark hardly shows in the luma. Codecs move a centroid by more than pixels show: in 18 clips of known truth the
# centroid has the smaller error wherever the ratio is below 0.25; from 0.3 to 0.45 either may have it.
CLEARER = 0.25
# Radius of a blob over that of its disc, and what chroma of half the resolution adds, px: in 13 drawn clips the ratio
# is at most 1.04 from 12 px on, and the difference at most 1.3 px below; a ring of light on a sticker made it 1.8.
WIDER, FRINGE_PX = 1.25, 1.2


def try_blob(
    start: BlobFollower, first: int, held: Sequence[tuple[Frame, Sighting]], cell: Array,
    *, surely: bool = False, disc_px: float = np.inf,
) -> Tried:  # fmt: skip
    """Follow a mark as a blob through the first frames; None if it is a disc that is visible in the luma.

    start: blob where it was first found, in the frame of index first. held: all of these frames, with the measurements
    as a disc. surely: follow it as a blob even if it may be a disc. disc_px: radius of the disc; a much larger blob is
    a mark in which gloss outlines the disc. Returns the follower after these frames, and its measurements.
    """
    blob = replace(start, color=start.color.copy(), outline=[])
    sightings, ratios, interval_s, before = list[Sighting](), list[float](), 0.0, start.time_s
    for frame, one in held:
        if frame.index < first or one.status == REPEATED:
            sightings.append(one)
            continue
        interval_s, before = frame.time_s - before or interval_s, frame.time_s
        place = blob.predicted(frame.time_s) or (0.0, 0.0)
        reach = NEARBY * (1 + blob.missed) * blob.radius_px
        sightings.append(blob.look_at(frame, cell, place, reach, interval_s))
        blob.accept(sightings[-1], frame.time_s)
        if sightings[-1].status == OK and blob.blob is not None:
            path = np.multiply(blob.velocity, interval_s)
            ratios.append(min(elongation(blob.blob.spread_px2, tuple(share * path)) for share in SHUTTERS))
    discs = [one for _, one in held if one.status == OK]
    if surely:
        return (blob, sightings) if len(ratios) > SELDOM * len(held) else None
    disc = np.median(ratios) < OBLONG and len(discs) >= SELDOM * len(ratios) if ratios else True
    disc = disc and blob.radius_px < WIDER * disc_px + FRINGE_PX
    lost = len(ratios) < SELDOM * sum(one.status == OK for frame, one in held if frame.index >= first)
    if lost or len(ratios) < FEW or (disc and not _variance(sightings) < CLEARER * _variance(discs)):
        return None
    return blob, sightings


def _variance(sightings: Sequence[Sighting]) -> float:
    """Usual variance of a centre in one frame, mean of the axes, px²."""
    return float(np.median([(one.var_x + one.var_y) / 2 for one in sightings if one.status == OK]))


def resized(follower: Follower, frame: Frame, cell: Array, one: Sighting) -> BlobFollower | None:
    """Continue as a blob if a mark has long differed from its disc and is smaller, because it is seen more obliquely.

    one: measurement in the frame. An occlusion also makes a mark smaller, but rarely for so long; a mark that was
    completely hidden counts as smaller only after it was seen whole.
    """
    if follower.unlike < UNLIKE or follower.hidden:
        return None
    place = (one.x, one.y) if one.status == OK else follower.last_sighting[0]
    if place is None or (one.status != OK and follower.last_sighting[1] < frame.time_s):
        return None
    blob = start_blob(frame, cell, place, follower.radius_px, follower.color, follower.exposure)
    found = blob.look_at(frame, cell, place, follower.radius_px, 0.0)
    if found.status != OK or blob.blob is None or blob.area_px2 > SMALLER * follower.look.area_px2:
        return None
    if abs(blob.blob.turned_rad) > OTHER_HUE:
        return None  # an arm or the floor where the mark was seen last
    blob.velocity = follower.velocity
    blob.accept(found, frame.time_s)
    return blob


def try_mover(
    name: str, held: Sequence[tuple[Frame, Sighting]], settings: TrackingSettings, cell: Array
) -> tuple[Tried, list[Candidate]]:
    """Follow a moving blob instead of one at rest, if a single mark was confused with an object at rest.

    held: the first frames, with their measurements. Returns the result of `try_blob` and the blobs at rest; None and an
    empty list if nothing else moves.
    """
    places = np.array([(one.x, one.y) for _, one in held if one.status == OK])
    if len(places) < FEW or float(np.ptp(places, axis=0).max()) > RESTING_PX:
        return None, []
    first = held[0][0]
    before, after = (candidates(frame, settings, [name]) for frame in (first, held[-1][0]))
    found, resting = mover(before, after)
    if found is None:
        return None, []
    color = learn_color(found, [], neutral_of(first, allowed_cells(first, settings)))
    start = start_blob(first, cell, found.center_px, found.radius_px, color, settings.exposure)
    tried = try_blob(start, first.index, held, cell, surely=True)
    return tried, resting if tried is not None else []


def learn_anew(followers: Followers, settings: TrackingSettings, held: Sequence[Held], cell: Array) -> None:
    """Learn the shapes of discs from all held frames, and measure in these again; in place."""
    discs = {
        name: (k, mark) for k, name in enumerate(settings.mark) if isinstance(mark := followers.get(name), Follower)
    }
    interval_s = float(np.median(np.diff([frame.time_s for frame, _ in held]))) if len(held) > 1 else 0.0
    for k, follower in discs.values():
        seen = [(frame, (s[k].x, s[k].y)) for frame, s in held if s[k].status == OK]
        patches = [patch_of(frame, place, follower.radius_px) for frame, place in seen[::2]]
        disc = finished(follower.learn_anew(patches, interval_s))
        if disc is not None:
            follower.take_look(with_disc(follower.look, disc))
    own = {name: follower.look for name, (_, follower) in discs.items()}
    agree(followers, settings.pair, Follower.take_look)
    partly = [name for name, (_, follower) in discs.items() if follower.look is not own[name]]
    measure_anew(followers, settings, held, cell, partly)


def measure_anew(
    followers: Followers, settings: TrackingSettings, held: Sequence[Held], cell: Array, partly: Collection[str] = ()
) -> None:
    """Measure discs again at their positions, with the shapes known by now; in place.

    partly: marks whose positions may be those of a visible part, so that their centres are within a radius.
    """
    for frame, sightings in held:
        for k, name in enumerate(settings.mark):
            follower, one = followers.get(name), sightings[k]
            if isinstance(follower, Follower) and one.status == OK:
                reach = follower.radius_px if name in partly else 2.0
                sightings[k] = follower.look_at(frame, cell, (one.x, one.y), reach, 0.0)


def choose_shapes(
    followers: Followers, settings: TrackingSettings, held: Sequence[Held], cell: Array, starts: Starts, rivals: Rivals
) -> None:
    """Follow marks that are not discs as blobs, from the first held frame on; in place.

    The visible part of an occluded disc may be oblong. It is one if it fits the disc of its partner, which is whole.
    """
    marks = list(enumerate(settings.mark))
    tried = {name: _as_blob(k, name, followers, settings, held, cell, starts, rivals) for k, name in marks}
    whole = [name for name in settings.pair if tried[name] is None and isinstance(followers.get(name), Follower)]
    for k, name in marks:
        blob, follower = tried[name], followers.get(name)
        if blob is None or (whole and name in settings.pair and isinstance(follower, Follower) and follower.occluded):
            continue
        followers[name] = blob[0]
        for (_, sightings), one in zip(held, blob[1], strict=True):
            sightings[k] = one


def _as_blob(
    k: int, name: str, followers: Followers, settings: TrackingSettings, held: Sequence[Held], cell: Array,
    starts: Starts, rivals: Rivals,
) -> Tried:  # fmt: skip
    """Follow the k-th mark as a blob through the held frames; None if it is a disc."""
    follower, mine = followers.get(name), [(frame, sightings[k]) for frame, sightings in held]
    if follower is not None and not settings.pair:
        tried, resting = try_mover(name, mine, settings, cell)
        rivals.exclude(resting)
        if tried is not None:
            return tried
    if not isinstance(follower, Follower):
        return None
    first, start = starts[name]
    return try_blob(start, first, mine, cell, disc_px=follower.look.disc.radius_px)
