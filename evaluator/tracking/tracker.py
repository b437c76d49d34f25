"""Find, learn, follow and find again all marks of a recording, one picture after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from evaluator.errors import InputError
from evaluator.recording import Frame
from evaluator.tracking.appearance import Appearance, learn_color, learn_shape, patch_of, with_disc
from evaluator.tracking.disc import Patch, make_disc
from evaluator.tracking.find import Candidate, allowed_cells, cell_of, find_marks, neutral_of
from evaluator.tracking.follow import ABSENT, OK, RELEARN_AT, Array, Follower, Point, Sighting
from evaluator.tracking.search import Search
from evaluator.tracking.settings import TrackingSettings

LEARNING_FRAMES = 12  # pictures a shape is learnt from; more do not improve the centre: shape and centre are orthogonal
# Light is measured in every second picture at first, then in every sixteenth: it belongs to the place, not to the time.
SHADING_MASK, SHADED, RARELY_MASK = 1, 512, 15
UNEQUAL = 0.08  # radii of equal marks differ by less: halation of a brighter mark, learning from noisy pictures
UNEQUAL_NOISE = 4.0  # and so does their noise: light and codec treat them alike
PATIENCE = 30  # pictures to wait for both marks of a pair before following one alone
STILL_PX = 0.3  # a mark that moves less a picture rests, and a codec may well repeat its picture
NOT_SEEN, REPEATED = ABSENT["not seen"], ABSENT["repeated picture"]


class Tracker:
    """Follows all marks through a recording; what it has learnt stays readable in `followers`."""

    def __init__(self, settings: TrackingSettings) -> None:
        """Start with nothing learnt."""
        self.settings = settings
        self.names = list(settings.mark)
        self.followers: dict[str, Follower] = {}
        self.cell: Array = np.zeros(4)
        self.interval_s = 1.0 / 60.0
        self._time_s: float | None = None
        self._shape: tuple[int, ...] = ()
        self._search: Search | None = None
        self._waited = 0

    def run(self, recording: Iterable[Frame]) -> Iterator[tuple[Frame, list[Sighting]]]:
        """Give every picture with the sightings of its marks, in the order of `names`.

        The first LEARNING_FRAMES pictures with a mark are held back until its shape is learnt from them.
        """
        pictures = iter(recording)
        held: list[tuple[Frame, list[Sighting]]] = []
        for frame in pictures:
            sightings = self.step(frame)
            if not self.followers:
                yield frame, sightings
                continue
            held.append((frame, sightings))
            if len(held) == LEARNING_FRAMES:
                break
        self._refine(held)
        for frame, sightings in held:
            yield frame, [self._again(name, frame, one) for name, one in zip(self.names, sightings, strict=True)]
        held.clear()
        for frame in pictures:
            yield frame, self.step(frame)

    def step(self, frame: Frame) -> list[Sighting]:
        """Measure all marks in the next picture."""
        time_s = frame.time_s
        if self._time_s is not None and time_s > self._time_s:
            self.interval_s = time_s - self._time_s
        self._time_s = time_s
        if frame.luma.shape != self._shape:
            self._prepare(frame)
        followers = self.followers
        if frame.repeated and any(f.step_px(self.interval_s) > STILL_PX for f in followers.values()):
            # The recorder filled a gap with the picture before: it shows where the marks were, not where they are.
            return [REPEATED] * len(self.names)
        if len(followers) < len(self.names):
            self._discover(frame)
        sightings = []
        for name in self.names:
            follower = followers.get(name)
            one = NOT_SEEN if follower is None else self._followed(follower, frame, time_s)
            if one.status != OK and follower is not None:
                one = self._found_again(name, frame, one)
            sightings.append(one)
        for name, one in zip(self.names, sightings, strict=True):
            if name in followers:
                followers[name].accept(one, time_s)
                self._note(name, frame, one)
        return sightings

    def _note(self, name: str, frame: Frame, one: Sighting) -> None:
        """Gather what is learnt on the way: shape from more places, light; give up what never fitted anything."""
        follower = self.followers[name]
        if one.status == OK:
            follower.keep_view(frame)
            if follower.seen in RELEARN_AT and follower.looks_changed():
                self._relearn(follower, follower.views)
                self._agree()
            if not frame.index & (SHADING_MASK if follower.seen < SHADED else RARELY_MASK):
                follower.note_shading(frame)
        elif follower.missed > PATIENCE and follower.seen < LEARNING_FRAMES:
            del self.followers[name]

    def _prepare(self, frame: Frame) -> None:
        if frame.u is None:
            raise InputError("the recording has no colour: green and yellow marks cannot be told apart in it")
        across, down = cell_of(frame)
        step = frame.row_step
        self.cell = np.array([across, down * step, (across - 1) / 2, frame.row_origin + (down - 1) / 2 * step], float)
        self._search = Search(frame, self.settings, self.cell)
        self._shape = frame.luma.shape

    def _followed(self, follower: Follower, frame: Frame, time_s: float) -> Sighting:
        place = follower.predicted(time_s)
        if place is None or follower.missed > 8:
            return NOT_SEEN
        # An acceleration may change the step by half of itself from one picture to the next; every miss adds to that.
        reach = (2.0 + 0.5 * follower.step_px(self.interval_s)) * (1 + follower.missed)
        return follower.look_at(frame, self.cell, place, reach, self.interval_s)

    def _found_again(self, name: str, frame: Frame, miss: Sighting) -> Sighting:
        """Look in the whole picture for a mark that is not where it should be."""
        assert self._search is not None
        follower = self.followers[name]
        places = self._search.places(name, frame, follower)
        expected = follower.predicted(frame.time_s)
        if expected is not None and follower.missed < 8:
            places.sort(key=lambda place: abs(place[0] - expected[0]) + abs(place[1] - expected[1]))
        for place in places[:3]:
            one = follower.look_at(frame, self.cell, place, 3.0, 0.0)
            if one.status == OK:
                return one
        return miss

    def _discover(self, frame: Frame) -> None:
        """Find marks that were never seen yet."""
        wanted = [name for name in self.names if name not in self.followers]
        chosen = find_marks(frame, self.settings, wanted)
        pair = len(self.names) > 1 and not self.followers
        self._waited += 1
        if not chosen or (pair and len(chosen) < len(wanted) and self._waited < PATIENCE):
            return
        neutral = neutral_of(frame, allowed_cells(frame, self.settings))
        for name, candidate in chosen.items():
            others = [other.chroma_uv for key, other in chosen.items() if key != name]
            others += [tuple(known.color[:2] + known.color[2:4]) for known in self.followers.values()]
            self._start(name, frame, candidate, learn_color(candidate, others, neutral))

    def _start(self, name: str, frame: Frame, candidate: Candidate, color: Array) -> None:
        disc = learn_shape([patch_of(frame, candidate.center_px, candidate.radius_px)], candidate.radius_px)
        if disc is None:
            return
        area = np.pi * max(candidate.radius_px**2, 0.8 * disc.radius_px**2)
        follower = Follower(Appearance(color, area, disc), self.settings.exposure)
        follower.position, follower.time_s = candidate.center_px, frame.time_s
        self.followers[name] = follower

    def _refine(self, held: list[tuple[Frame, list[Sighting]]]) -> None:
        """Learn the shapes anew from the pictures held."""
        for k, name in enumerate(self.names):
            follower = self.followers.get(name)
            if follower is None:
                continue
            seen: list[tuple[Frame, Point]] = [(f, (s[k].x, s[k].y)) for f, s in held if s[k].status == OK]
            patches = [patch_of(frame, place, follower.radius_px) for frame, place in seen[::2]]
            self._relearn(follower, patches)
        self._agree()

    def _relearn(self, follower: Follower, patches: list[Patch]) -> None:
        disc = learn_shape(patches, follower.radius_px)
        if disc is not None:
            follower.take_look(with_disc(follower.look, disc))

    def _agree(self) -> None:
        """Give the two marks of a robot one shape where one of them was partly hidden: they are equal discs."""
        if not {"green", "yellow"} <= self.followers.keys():
            return
        marks = [self.followers[name] for name in ("green", "yellow")]
        worse, better = sorted(marks, key=lambda mark: mark.radius_px)
        if worse.radius_px > (1 - UNEQUAL) * better.radius_px:
            better, worse = sorted(marks, key=lambda mark: mark.look.disc.noise[0])
            if worse.look.disc.noise[0] < UNEQUAL_NOISE * better.look.disc.noise[0]:
                return
        shape, own = better.look.disc, worse.look.disc
        slant, level = (shape.e1, shape.e2), (own.amplitude, own.base)
        disc = make_disc(shape.radius_px, shape.blur_px, slant, level, shape.noise)
        worse.take_look(with_disc(worse.look, disc))

    def _again(self, name: str, frame: Frame, one: Sighting) -> Sighting:
        if one.status != OK:
            return one
        return self.followers[name].look_at(frame, self.cell, (one.x, one.y), 2.0, 0.0)
