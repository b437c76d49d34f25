"""Frames → a table of sub-pixel mark centres with their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain

import numpy as np
import pandas as pd

from evaluator.errors import InputError
from evaluator.recording import Frame
from evaluator.tracking.appearance import Appearance, learn
from evaluator.tracking.find import Candidate, allowed_cells, candidates, choose, color_map
from evaluator.tracking.follow import OK, Follower, Sighting, absent
from evaluator.tracking.settings import TrackingSettings

Progress = Callable[[int], None]
LEARNING_FRAMES = 12  # pictures a mark is learnt from; more do not improve the centre: shape and centre are orthogonal
PARTS = ("x_px", "y_px", "x_sigma_px", "y_sigma_px", "xy_cov_px2", "status")


def track(
    recording: Iterable[Frame], settings: TrackingSettings | None = None, progress: Progress | None = None
) -> pd.DataFrame:
    """Track the marks of a recording.

    Returns a row per picture: frame, time_s, and per mark (green, yellow, or those of the settings) NAME_x_px,
    NAME_y_px, NAME_x_sigma_px, NAME_y_sigma_px, NAME_xy_cov_px2 (standard uncertainties and covariance of this
    picture's centre) and NAME_status: "ok", or why the mark is absent (its numbers are then NaN). Picture frame, px.
    progress: called with the number of pictures done. Raises InputError for a recording without colour.
    """
    tracker = Tracker(settings or TrackingSettings())
    times: list[float] = []
    frames: list[int] = []
    rows: list[list[Sighting]] = []
    for frame, sightings in tracker.run(recording):
        times.append(frame.time_s)
        frames.append(frame.index)
        rows.append(sightings)
        if progress is not None and len(rows) % 64 == 0:
            progress(len(rows))
    if progress is not None:
        progress(len(rows))
    return to_table(list(tracker.settings.mark), frames, times, rows)


def to_table(names: list[str], frames: list[int], times: list[float], rows: list[list[Sighting]]) -> pd.DataFrame:
    """Columns of `track` from the sightings of all marks in all pictures."""
    columns: dict[str, object] = {"frame": np.array(frames, int), "time_s": np.array(times, float)}
    for k, name in enumerate(names):
        numbers = np.array([row[k][:5] for row in rows], float).reshape(-1, 5)
        values = [numbers[:, 0], numbers[:, 1], np.sqrt(numbers[:, 2]), np.sqrt(numbers[:, 3]), numbers[:, 4]]
        for part, value in zip(PARTS[:5], values, strict=True):
            columns[f"{name}_{part}"] = value
        columns[f"{name}_status"] = [row[k].status for row in rows]
    return pd.DataFrame(columns)


class Tracker:
    """Follows all marks through a recording; what it has learnt stays readable in `followers`."""

    def __init__(self, settings: TrackingSettings) -> None:
        """Start with nothing learnt."""
        self.settings = settings
        self.names = list(settings.mark)
        self.followers: dict[str, Follower] = {}
        self._interval_s = 1.0 / 60.0
        self._time_s: float | None = None

    def run(self, recording: Iterable[Frame]) -> Iterator[tuple[Frame, list[Sighting]]]:
        """Give every picture with the sightings of its marks, in the order of `names`."""
        pictures = iter(recording)
        held: list[Frame] = []
        seen: list[dict[str, Candidate]] = []
        for frame in pictures:
            if frame.u is None:
                raise InputError("the recording has no colour: green and yellow marks cannot be told apart in it")
            chosen = dict(choose(candidates(frame, self.settings, self.names), self.settings))
            if chosen or seen:
                held.append(frame)
                seen.append(chosen)
            else:
                yield frame, [absent("not seen") for _ in self.names]
            if len(held) >= LEARNING_FRAMES:
                break
        self._learn(held, seen)
        for frame in chain(held, pictures):
            yield frame, self.step(frame)

    def _learn(self, held: list[Frame], seen: list[dict[str, Candidate]]) -> None:
        if not held:
            return
        neutral = np.array(color_map(held[0], allowed_cells(held[0], self.settings)).neutral_uv)
        found = {
            name: [(frame, chosen[name]) for frame, chosen in zip(held, seen, strict=True) if name in chosen]
            for name in self.names
            if name not in self.followers
        }
        colors = {
            name: np.median([candidate.chroma_uv for _, candidate in ones], axis=0)
            for name, ones in found.items()
            if ones
        }
        for name in colors:
            others = [color for other, color in colors.items() if other != name]
            look: Appearance | None = learn(found[name], others, neutral)
            if look is not None:
                self.followers[name] = Follower(look, self.settings.exposure)

    def step(self, frame: Frame) -> list[Sighting]:
        """Measure all marks in the next picture."""
        time_s = frame.time_s
        if self._time_s is not None and time_s > self._time_s:
            self._interval_s = time_s - self._time_s
        self._time_s = time_s
        sightings = {name: self._followed(self.followers.get(name), frame) for name in self.names}
        lost = [name for name, one in sightings.items() if one.status != OK and name in self.followers]
        if lost:
            sightings |= self._found_again(frame, lost)
        for name, follower in self.followers.items():
            follower.accept(sightings[name], time_s)
        return [sightings[name] for name in self.names]

    def _followed(self, follower: Follower | None, frame: Frame) -> Sighting:
        if follower is None:
            return absent("not seen")
        place = follower.predicted(frame.time_s)
        if place is None or follower.missed > 10:
            return absent("not seen")
        speed = float(np.hypot(*follower.velocity)) * self._interval_s
        # An acceleration may change the step by half of itself from one picture to the next; every miss doubles that.
        reach = (2.0 + 0.5 * speed) * (1 + follower.missed)
        return follower.look_at(frame, place, reach, self._interval_s)

    def _found_again(self, frame: Frame, lost: list[str]) -> dict[str, Sighting]:
        blobs = candidates(frame, self.settings, lost)
        again: dict[str, Sighting] = {}
        for name in lost:
            follower = self.followers[name]
            alike = [blob for blob in blobs if blob.mark == name and follower.resembles(blob)]
            if not alike:
                continue
            place = follower.predicted(frame.time_s)
            near = place or alike[0].center_px
            best = min(
                alike, key=lambda blob: float(np.hypot(blob.center_px[0] - near[0], blob.center_px[1] - near[1]))
            )
            sighting = follower.look_at(frame, best.center_px, 2.0, self._interval_s)
            if sighting.status == OK:
                again[name] = sighting
        return again
