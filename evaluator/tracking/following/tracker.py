"""Find, learn, follow and recover all marks of a recording, frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from evaluator.errors import InputError
from evaluator.recording import Frame
from evaluator.tracking.camera_motion import CameraMotion
from evaluator.tracking.detection.appearance import Appearance, learn_color, learn_shape, patch_of
from evaluator.tracking.detection.chroma_siting import first_column
from evaluator.tracking.detection.color_map import allowed_cells, cell_of, neutral_of
from evaluator.tracking.detection.find import Reading, find_marks
from evaluator.tracking.detection.lookalikes import Rivals
from evaluator.tracking.detection.search import Search, mean_light
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.following.equal_discs import agree
from evaluator.tracking.following.follow import RELEARN_AT, Array, Follower
from evaluator.tracking.following.follow_blob import BlobFollower, look_back, start_blob
from evaluator.tracking.following.lessons import LEARNING_FRAMES, Lessons
from evaluator.tracking.following.motion import Point
from evaluator.tracking.following.pair import Body
from evaluator.tracking.following.second_look import SecondLook, at_place_of, beside_partner, covers
from evaluator.tracking.following.shape import OBLONG, Held, Starts, choose_shapes, learn_anew, measure_anew, resized
from evaluator.tracking.observation import ABSENT, OK, REPEATED, Sighting
from evaluator.tracking.refinement.disc import shaped_as
from evaluator.tracking.refinement.learn_shape import finished
from evaluator.tracking.settings import TrackingSettings

# Light is measured in every second frame, and after SHADED frames in every sixteenth: it depends on the place, not on
# time.
SHADING_MASK, SHADED, RARELY_MASK = 1, 512, 15
NEAR_MISSES = 8  # frames for which a lost mark is first sought near its predicted position
DARKEST = 0.2  # of the earlier light: limit to which dimming is compensated in the search for known marks
LIGHT_MASK = 7  # the mean light is measured in every eighth frame
PATIENCE = 30  # frames to wait for both marks of a pair before following one alone
DISCLESS = 3  # frames with a mark's colour, but no disc, after which it is followed as a blob
STILL_PX = 0.3  # a mark that moves by less in a frame rests; a codec may then repeat its frame without harm
NOT_SEEN, AGAIN, AMBIGUOUS = ABSENT["not seen"], ABSENT[REPEATED], ABSENT["ambiguous"]


class Tracker:
    """Follows all marks through a recording; `followers` holds what it has learnt."""

    def __init__(self, settings: TrackingSettings) -> None:
        """Start without knowledge."""
        self.settings = settings
        self.names = list(settings.mark)
        self.followers: dict[str, Follower | BlobFollower] = {}
        self._starts: Starts = {}  # first frame and blob of each mark, as if it were no disc
        self._discless = dict.fromkeys(self.names, 0)  # number of frames with its colour, but no disc
        self._settled = False  # whether the first frames have shown which marks are discs
        self.cell: Array = np.zeros(4)
        self.interval_s = 1.0 / 60.0
        self._time_s: float | None = None
        self._shape: tuple[int, ...] = ()
        self._search: Search | None = None
        self._waited, self._source = 0, "the recording"
        self.body, self._rivals, self._light, self._dimmed = Body(), Rivals(), 0.0, 1.0
        self._lessons = Lessons()
        self.second_look, self.camera = SecondLook(), CameraMotion()
        self.began: dict[str, int] = {}  # index of the first frame of the mark; before it another object was followed

    def run(self, recording: Iterable[Frame]) -> Iterator[tuple[Frame, list[Sighting]]]:
        """Yield every frame with the sightings of its marks, in the order of `names`.

        The first LEARNING_FRAMES frames with a mark are delayed until its shape is learnt from them.
        """
        self._source = getattr(recording, "name", self._source)
        before, held = list[Held](), list[Held]()  # last frames before a mark was begun, which may show it; with marks
        unlearnt, learnt = list[Held](), False  # frames before a mark was replaced; measured with first shapes
        for frame in recording:
            began, sightings = dict(self.began), self.step(frame)
            if self.began != began:  # a mark was replaced: the held frames show another object
                yield from unlearnt
                unlearnt, held, learnt = held, [], False
            if learnt:
                yield frame, sightings
                continue
            if not self.followers:
                before = [*unlearnt, *held, *before, (frame, sightings)]
                yield from before[: 1 - DISCLESS]
                unlearnt, held, before = [], [], before[1 - DISCLESS :]
                continue
            missed = look_back(self.followers, self.names, before, self.cell)
            yield from before[:missed]
            held, before = [*held, *before[missed:], (frame, sightings)], []
            if len(held) == LEARNING_FRAMES:
                yield from self._learnt(unlearnt, held)
                unlearnt, held, learnt = [], [], True
        yield from before
        yield from self._learnt(unlearnt, held)

    def _learnt(self, unlearnt: list[Held], held: list[Held]) -> list[Held]:
        """The first frames with marks, measured again with the shapes learnt from the held ones."""
        learn_anew(self.followers, self.settings, held, self.cell)
        measure_anew(self.followers, self.settings, unlearnt, self.cell)
        self._settled = True
        choose_shapes(self.followers, self.settings, held, self.cell, self._starts, self._rivals)
        return [*unlearnt, *held]

    def step(self, frame: Frame) -> list[Sighting]:
        """Measure all marks in the next frame."""
        time_s = frame.time_s
        if self._time_s is not None and time_s > self._time_s:
            self.interval_s = time_s - self._time_s
        self._time_s = time_s
        if frame.luma.shape != self._shape:
            self._prepare(frame)
        followers = self.followers
        if frame.repeated and any(f.step_px(self.interval_s) > STILL_PX for f in followers.values()):
            # The recorder filled a gap with the frame before: it shows earlier positions of the marks.
            return [AGAIN] * len(self.names)
        self._discover(frame)
        sightings = self._all_followed(frame, time_s)
        if any(one.status != OK for one in sightings):
            self._recover(frame, sightings)
        elif not frame.index & LIGHT_MASK:
            self._light = mean_light(frame)
        self._note_distance(sightings)
        if self.settings.pair and not self.second_look.plausible:
            self.camera.note(frame, [(*f.position, f.radius_px) for f in followers.values() if f.position is not None])
        if self._lessons and self._lessons.go_on():
            agree(followers, self.settings.pair, Follower.take_shape)
        for name, one in zip(self.names, sightings, strict=True):
            if name in followers:
                followers[name].accept(one, time_s)
                self._note(name, frame, one)
        return sightings

    def _note(self, name: str, frame: Frame, one: Sighting) -> None:
        """Update what is learnt during tracking: shape from more positions, light; drop marks that never fit."""
        follower = self.followers[name]
        if isinstance(follower, Follower) and self._settled and (blob := resized(follower, frame, self.cell, one)):
            self.followers[name] = blob
        elif one.status == OK:
            if isinstance(follower, BlobFollower):
                return
            follower.keep_view(frame)
            if follower.seen in RELEARN_AT and follower.views and follower.looks_changed():
                self._lessons.begin(follower, follower.views, self.interval_s)
            if not frame.index & (SHADING_MASK if follower.seen < SHADED else RARELY_MASK):
                follower.note_light(frame)
        elif (
            follower.missed > (PATIENCE if isinstance(follower, Follower) else NEAR_MISSES)
            and follower.seen < LEARNING_FRAMES
        ):
            del self.followers[name]

    def _prepare(self, frame: Frame) -> None:
        if frame.u is None:
            raise InputError(f"{self._source} has no colour: coloured marks cannot be distinguished in it")
        across, down = cell_of(frame)
        step = frame.row_step
        left, top = first_column(frame), frame.row_origin + (down - 1) / 2 * step
        self.cell = np.array([across, down * step, left, top], float)
        self._search = Search(frame, self.settings, self.cell)
        self._shape = frame.luma.shape

    def _all_followed(self, frame: Frame, time_s: float) -> list[Sighting]:
        found = [self._followed(self.followers.get(name), frame, time_s) for name in self.names]
        if self.settings.pair and self.body.at_one_place(found[0][:2], found[1][:2]):
            return [AMBIGUOUS] * 2
        return found

    def _followed(self, follower: Follower | BlobFollower | None, frame: Frame, time_s: float) -> Sighting:
        place = None if follower is None else follower.predicted(time_s)
        if follower is None or place is None or follower.missed > NEAR_MISSES:
            return AMBIGUOUS if self._rivals.undecided else NOT_SEEN
        # An acceleration may change a step by half from one frame to the next; the range grows with every miss.
        reach = (2.0 + 0.5 * follower.step_px(self.interval_s)) * (1 + follower.missed)
        return follower.look_at(frame, self.cell, place, reach, self.interval_s)

    def _recover(self, frame: Frame, sightings: list[Sighting]) -> None:
        """Search the whole image for marks that are not at their predicted positions; in place.

        Two marks of one robot are accepted only at their distance, or one of them where the robot can be.
        """
        pair, body = bool(self.settings.pair), self.body
        lost = [k for k, one in enumerate(sightings) if one.status != OK and self.names[k] in self.followers]
        self._dimmed = max(mean_light(frame) / self._light, DARKEST) if self._light else 1.0
        places = {k: self._places(self.names[k], frame) for k in lost}
        for k in lost:
            follower, mine = self.followers[self.names[k]], places[k]
            partner = sightings[1 - k] if pair else NOT_SEEN
            guide = (0.0, 0.0)
            if partner.status == OK:
                mine = body.paired(mine, [partner[:2]])
                guide = self.followers[self.names[1 - k]].velocity
            elif pair and body.known:
                mine = body.paired(mine, places.get(1 - k, [])) or [
                    place for place in mine if follower.may_be_at(place, self.interval_s, body.distance_px)
                ]
            sightings[k] = self._found_again(follower, frame, mine, guide, sightings[k])
            if sightings[k].status == OK and partner.status != OK:
                body.confirmed = False
            if pair and partner.status == OK and not mine and places[k] and not body.confirmed and body.known:
                self._leave_lookalike(frame, sightings, k, places[k])

    def _leave_lookalike(self, frame: Frame, sightings: list[Sighting], k: int, mine: list[Point]) -> None:
        """If a mark was found alone but a consistent pair exists elsewhere, follow that pair instead; in place."""
        name, other = self.names[k], self.names[1 - k]
        theirs = self._places(other, frame)
        for key, places in ((1 - k, self.body.paired(theirs, mine)), (k, self.body.paired(mine, theirs))):
            follower = self.followers[(name, other)[key != k]]
            found = self._found_again(follower, frame, places, (0.0, 0.0), sightings[key])
            if found.status != OK:
                return
            sightings[key] = found

    def _places(self, name: str, frame: Frame) -> list[Point]:
        assert self._search is not None
        places = self._search.places(name, frame, self.followers[name], self._dimmed)
        return [place for place in places if not self._rivals.there(place, self.followers[name].radius_px)]

    def _found_again(
        self, follower: Follower | BlobFollower, frame: Frame, places: list[Point], guide: Point, miss: Sighting
    ) -> Sighting:
        """Measure a mark at the most probable of its possible positions."""
        expected = follower.predicted(frame.time_s)
        if expected is not None and follower.missed < NEAR_MISSES:
            places = sorted(places, key=lambda place: abs(place[0] - expected[0]) + abs(place[1] - expected[1]))
        for place in places[:3]:
            one = follower.look_again(frame, self.cell, place, self.interval_s, guide, self._dimmed)
            if one.status == OK:
                return one
        if places:
            follower.last_sighting = places[0][:2], frame.time_s
        return miss

    def _note_distance(self, sightings: list[Sighting]) -> None:
        if self.settings.pair and sightings[0].status == OK == sightings[1].status:
            self.body.note(sightings[0][:2], sightings[1][:2])

    def _discover(self, frame: Frame) -> None:
        """Find marks that have not been seen yet, and a more probable pair than the followed one."""
        better = self.second_look.better(frame, self.settings, self.followers)
        if better and not any(self._rivals.there(one.center_px, one.radius_px) for one in better.chosen.values()):
            self._begin_anew(frame, better)  # elsewhere than at a lookalike that rested while the robot began to move
        wanted = [name for name in self.names if name not in self.followers]
        if not wanted:
            return
        found = find_marks(frame, self.settings, wanted)
        chosen = beside_partner(found, self.settings, self.followers, frame.time_s)
        pair = len(self.names) > 1 and not self.followers
        self._waited += 1
        waiting = self._waited < PATIENCE or self._rivals.undecided
        if not chosen or (pair and len(chosen) < len(wanted) and waiting):
            return
        if self.settings.pair and len(chosen) == len(self.settings.pair):
            chosen = self._rivals.decide(found.blobs, self.settings, chosen)
        self._start_all(frame, chosen, found.balance)

    def _begin_anew(self, frame: Frame, better: Reading) -> None:
        """Follow another pair; the objects followed elsewhere were not the robot."""
        known, self._lessons, self.body = dict(self.followers), Lessons(), Body()
        self.followers.clear()
        for name, one in better.chosen.items():
            if at_place_of(one, known.get(name), frame.time_s):
                self.followers[name] = known[name]
            else:
                self.began[name] = frame.index
        self._start_all(
            frame, {name: better.chosen[name] for name in self.names if name not in self.followers}, better.balance
        )

    def _start_all(self, frame: Frame, chosen: dict[str, Candidate], balance: float) -> None:
        neutral = neutral_of(frame, allowed_cells(frame, self.settings), balance)
        if self.settings.pair and len(chosen) == len(self.settings.pair):
            self.second_look.note(chosen, self.settings)
        for name, candidate in chosen.items():
            now = ((known, self._followed(known, frame, frame.time_s)) for known in self.followers.values())
            if any(covers(known, one, candidate, frame.time_s) for known, one in now):
                continue  # two marks are never at one position
            others = [other.chroma_uv for key, other in chosen.items() if key != name]
            others += [tuple(known.color[:2] + known.color[2:4]) for known in self.followers.values()]
            self._start(name, frame, candidate, learn_color(candidate, others, neutral))

    def _start(self, name: str, frame: Frame, candidate: Candidate, color: Array) -> None:
        if not candidate.whole:  # it is cut by the border of the image, so that its shape is unknown
            return
        where = candidate.center_px, candidate.radius_px
        self.second_look.begin()
        disc = finished(learn_shape([patch_of(frame, *where)], candidate.radius_px))
        blob = start_blob(frame, self.cell, *where, color, self.settings.exposure)
        self._starts[name] = frame.index, blob
        self._discless[name] += disc is None
        if self._discless[name] >= DISCLESS or (self._settled and candidate.elongation > OBLONG):
            self.followers[name] = blob
            return
        if disc is None:
            return
        pair = self.settings.pair
        partner = self.followers.get(next(other for other in pair if other != name)) if name in pair else None
        if isinstance(partner, Follower) and partner.seen >= LEARNING_FRAMES:
            # An object that hid it for so long may still cover or light it: use the shape of its partner.
            disc = shaped_as(disc, partner.look.disc)
        area = np.pi * max(candidate.radius_px**2, 0.8 * disc.radius_px**2)
        follower = Follower(Appearance(color, area, disc), self.settings.exposure)
        follower.position, follower.time_s = candidate.center_px, frame.time_s
        self.followers[name] = follower
