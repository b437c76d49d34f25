"""Check whether the followed marks are those that a search of the whole frame would choose now.

When a recording begins, other objects in view (a cup, a sleeve, one mark taken for the other in the dark) may be the
most probable pair, until the robot appears or a lamp is switched on. Until two marks have travelled as one body, frames
are therefore searched again; if several in a row show a good pair elsewhere, that pair is followed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from evaluator.recording import Frame
from evaluator.tracking.detection.find import GOOD, Reading, find_marks
from evaluator.tracking.detection.selection import Candidate, alike, choose
from evaluator.tracking.following.background import TRAVELS
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.following.motion import Point
from evaluator.tracking.following.pair import TOLERANCE
from evaluator.tracking.observation import OK, Sighting
from evaluator.tracking.settings import TrackingSettings

Pair = dict[str, Candidate]
Followers = Mapping[str, Follower | BlobFollower]
# A search takes as long as ten frames of tracking. It is done in every sixteenth frame of a robot at rest, and in every
# fourth frame if one of the marks is sought anyway.
SELDOM_MASK, OFTEN_MASK = 15, 3
IN_A_ROW = 3  # frames that show another pair before it is accepted; flicker and codec residue are shorter
NEARBY = 2.0  # radii: tolerance of a predicted position, in addition to the motion in a frame
WITHIN = 1.0  # radii: two marks do not overlap so far, also if they touch (halves of one square)


class SecondLook:
    """Checks the followed marks until both have travelled as one body."""

    def __init__(self) -> None:
        """Start with nothing followed.

        plausible: whether the followed pair looked like the marks of a robot in some frame.
        """
        self.plausible = False
        self._began: dict[str, Point] = {}  # positions at which both were first followed together
        self._sure = False
        self._in_a_row = 0

    def begin(self) -> None:
        """Record that a mark begins to be followed."""
        self._began, self._sure = {}, False

    def note(self, pair: Pair, settings: TrackingSettings) -> None:
        """Record the plausibility of a pair that is followed from now on; regions from the user make it plausible."""
        said = all(settings.mark[name].region_px is not None for name in pair)
        self.plausible |= said or choose(list(pair.values()), settings)[1] > GOOD

    def better(self, frame: Frame, settings: TrackingSettings, followers: Followers) -> Reading | None:
        """The pair to follow from this frame on; None while the followed pair is kept."""
        if not followers or not settings.pair or not self._doubtful(settings, followers):
            return None
        alone = len(followers) < len(settings.pair)
        if not self._in_a_row and frame.index & (OFTEN_MASK if alone else SELDOM_MASK):
            return None
        found = find_marks(frame, settings, list(settings.pair))
        complete = len(found.chosen) == len(settings.pair) and all(one.whole for one in found.chosen.values())
        good = complete and choose(found.blobs, settings)[1] > GOOD
        known = good and any(_followed(pair, followers, frame.time_s) for pair in alike(found.blobs, settings))
        self.plausible |= known
        self._in_a_row = self._in_a_row + 1 if good and not known else 0
        if self._in_a_row < IN_A_ROW:
            return None
        self._in_a_row = 0
        return found

    def _doubtful(self, settings: TrackingSettings, followers: Followers) -> bool:
        """Whether the marks have not travelled as one body yet."""
        places = {name: one.position for name, one in followers.items() if one.position is not None and not one.missed}
        if self._sure or len(places) < len(settings.pair):
            return not self._sure
        self._began = self._began or places
        way = min(math.dist(places[name], self._began[name]) / followers[name].radius_px for name in places)
        before, now = math.dist(*self._began.values()), math.dist(*places.values())
        self._sure = way > TRAVELS and abs(now - before) < TOLERANCE * before
        return not self._sure


def at_place_of(
    one: Candidate, follower: Follower | BlobFollower | None, time_s: float, nearby: float = NEARBY
) -> bool:
    """Whether a blob is at the position of a followed mark, within a number of radii."""
    place = None if follower is None else follower.predicted(time_s)
    if follower is None or place is None:
        return False
    way = math.dist(place, follower.position or place)
    return math.dist(one.center_px, place) < nearby * max(one.radius_px, 1.0) + way


def covers(known: Follower | BlobFollower, measured: Sighting, blob: Candidate, time_s: float) -> bool:
    """Whether a blob is a followed mark, as measured in the frame of the blob, or else as predicted."""
    if measured.status != OK:
        return at_place_of(blob, known, time_s, WITHIN)
    # A prediction allows for the motion in a frame, within which a fast mark's partner lies.
    return math.dist(measured[:2], blob.center_px) < WITHIN * max(blob.radius_px, 1.0)


def beside_partner(found: Reading, settings: TrackingSettings, followers: Followers, time_s: float) -> Pair:
    """The most probable blobs of a search, beside the other mark of the pair if that is followed already.

    By itself, the mark of another robot may be as probable.
    """
    known = [
        Candidate(name, place, followers[name].radius_px, elongation=1.0, chroma=1.0, chroma_uv=(0.0, 0.0))
        for name in settings.pair
        if name in followers and (place := followers[name].predicted(time_s)) is not None
    ]
    chosen = choose([*found.blobs, *known], settings)[0] if known and found.chosen else found.chosen
    return {name: chosen[name] for name in found.chosen}


def _followed(pair: Pair, followers: Followers, time_s: float) -> bool:
    """Whether all followed marks belong to a pair."""
    return all(at_place_of(pair[name], follower, time_s) for name, follower in followers.items())
