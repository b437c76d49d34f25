"""Over a whole recording: what is taken off centres, added to their variances, and taken out, and why."""

from __future__ import annotations

import math
import tracemalloc
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq

from evaluator.tracking import repeated_note
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.observation import (
    ALONE,
    BACKGROUND,
    OFF_COURSE,
    OK,
    REPEATED,
    STRANGER,
    UNLIKE,
    WRONG_DISTANCE,
)
from evaluator.tracking.uncertainty import combine
from evaluator.tracking.uncertainty.motion_changes import around, smeared
from evaluator.tracking.uncertainty.shared_errors import _square, straight_frames

COUNT = 200
FRAME_S = 1 / 60
TIME_S = FRAME_S * np.arange(COUNT)
REST = np.tile([300.0, 200.0], (COUNT, 1))


def circle(radius: float = 100.0, turn: float = 0.02, phase: float = 0.0) -> np.ndarray:
    """A mark on a body that turns by so much a frame."""
    angle = turn * np.arange(COUNT) + phase
    return np.array([200.0, 200.0]) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def numbers_of(places: np.ndarray, sigma: float = 0.01, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """Centres with noise, and the variances that are stated; (n, 5)."""
    off = noise * np.random.default_rng(seed).normal(size=places.shape)
    return np.column_stack([places + off, np.tile([sigma**2, sigma**2, 0.3 * sigma**2], (len(places), 1))])


def refined(
    numbers: dict[str, np.ndarray], followers: dict[str, Any] | None = None, **said: Any
) -> dict[str, list[str]]:
    """Why each mark is absent, frame by frame, once `refine` has corrected its numbers in place."""
    status = {name: [OK] * len(values) for name, values in numbers.items()}
    combine.refine(TIME_S[: len(status["green"])], ["P"] * COUNT, numbers, status, followers or {}, **said)
    return status


class Disc(Follower):
    """Stands for a follower of a disc, which light shifts by (2, 3) px in even frames, ±0.1 px."""

    radius_px = 8.0
    shutter = (0.5, 0.1)

    def __init__(self) -> None:
        self.look: Any = SimpleNamespace(disc=SimpleNamespace(shade=(0.0, 0.0), blur_px=0.8, radius_px=5.0))
        shift: Any = lambda places: (np.tile([2.0, 3.0], (len(places), 1)), np.full(len(places), 0.01))  # noqa: E731
        self.light: Any = SimpleNamespace(
            learnt=lambda _disc: SimpleNamespace(shift=shift), shifted=lambda times: np.arange(len(times)) % 2 == 0
        )
        self.offsets: Any = SimpleNamespace(variance=lambda times: np.full(len(times), 0.125))


class Blob(BlobFollower):
    """Stands for a follower of a sticker of any shape."""

    radius_px = 8.0
    shutter = (0.5, 0.1)

    def __init__(self) -> None:
        self.outline = [(0.0, 1.0, 1.0, 0.0)]


def only(monkeypatch: pytest.MonkeyPatch, **kept: Any) -> None:
    """Nothing is known of the course, the exposure and what cannot be, but for what is given."""
    nothing: dict[str, Any] = {
        "hidden_variance": lambda times, *_: np.zeros(len(times)),
        "exposed": lambda times, *_: (np.zeros((len(times), 2)),) * 2,
        "widen_by_outline": lambda *_: None,
        "widen_by_shape": lambda *_: None,
        "_allow_for_onsets": lambda _values: None,
        "_take_out_impossible": lambda *_: None,
        "_hold_together": lambda *_: None,
    }
    for name, stub in (nothing | kept).items():
        monkeypatch.setattr(combine, name, stub)


def test_shifts_of_light_and_exposure_are_taken_off_and_all_variances_added(monkeypatch: pytest.MonkeyPatch) -> None:
    def exposed(times: np.ndarray, centers: np.ndarray, _variances: Any, shutter: Any) -> Any:
        assert shutter == (0.5, 0.1)
        np.testing.assert_allclose(centers[0], start[0, :2] - [2.0, 3.0])  # as light leaves it
        return np.tile([0.5, -0.25], (len(times), 1)), np.tile([0.04, 0.05], (len(times), 1))

    def hidden(times: np.ndarray, _centers: np.ndarray, mean: np.ndarray, kinds: Any, *near: Any) -> np.ndarray:
        assert (set(kinds), near) == ({"P"}, (None, None))
        np.testing.assert_allclose(mean, np.where(np.arange(COUNT) % 2 == 0, 0.01, 0.0) + 1e-4 + 0.045)
        return np.full(len(times), 0.5)

    only(monkeypatch, exposed=exposed, hidden_variance=hidden)
    start, numbers = numbers_of(circle()), {"green": numbers_of(circle())}
    refined(numbers, {"green": Disc()})
    even = (np.arange(COUNT) % 2 == 0)[:, None]
    np.testing.assert_allclose(start[:, :2] - numbers["green"][:, :2], [0.5, -0.25] + even * [2.0, 3.0])
    np.testing.assert_allclose(numbers["green"][:, 2:4] - start[:, 2:4], [0.665, 0.675] + even * [0.01, 0.01])
    np.testing.assert_array_equal(numbers["green"][:, 4], start[:, 4])


def test_outlines_shapes_and_onsets_are_allowed_for_each_of_its_kind_of_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[Any] = []
    only(
        monkeypatch,
        widen_by_outline=lambda times, _values, outline: called.append(("outline", len(times), outline)),
        widen_by_shape=lambda _numbers, corners, center: called.append(("shape", corners, center)),
        _allow_for_onsets=lambda values: called.append(("onsets", len(values))),
        hidden_variance=lambda times, *_: called.append(("course", len(times))) or np.zeros(len(times)),
    )
    numbers = {"green": numbers_of(circle()), "tag": numbers_of(circle())}
    refined(numbers, {"green": Blob()}, tags={"tag": ["a", "b"]})
    course, onsets = ("course", COUNT), ("onsets", COUNT)
    assert called == [("shape", ["a", "b"], "tag"), ("outline", COUNT, Blob().outline), onsets, course, course]
    called.clear()
    refined({"green": numbers_of(circle())}, {"green": Disc()})
    assert called == [onsets, course]


def test_repeated_frames_are_taken_out_and_have_no_course(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    only(monkeypatch, hidden_variance=lambda times, *_: seen.append(len(times)) or np.zeros(len(times)))
    places = circle()
    places[50] = places[49]  # and then two steps at once
    numbers = {"green": numbers_of(places)}
    assert np.flatnonzero(np.array(refined(numbers)["green"]) == REPEATED).tolist() == [50]
    assert np.flatnonzero(np.isnan(numbers["green"][:, 0])).tolist() == [50]
    assert seen == [COUNT - 1]
    blank = {"green": np.full((COUNT, 5), np.nan)}
    seen.clear()
    refined(blank)
    assert seen == []


@pytest.mark.parametrize(
    ("background", "places", "taken"),
    [(0 * REST, REST, True), (0 * REST, circle(), False), (None, REST, False), (circle() - REST, circle(), True)],
)
def test_marks_that_never_looked_like_a_robots_have_to_travel_against_the_background(
    background: np.ndarray | None, places: np.ndarray, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch)
    numbers = {"green": numbers_of(places)}
    status = refined(numbers, {"green": Disc()}, background_px=background)["green"]
    assert set(status) == ({UNLIKE} if taken else {OK})


def impossible(green: np.ndarray, yellow: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> list[set[str]]:
    keep = combine._take_out_impossible
    only(monkeypatch, _take_out_impossible=keep)
    numbers = {"green": numbers_of(green), "yellow": numbers_of(yellow)}
    status = refined(numbers, {name: Disc() for name in numbers}, body=("green", "yellow"))
    for name, values in numbers.items():
        np.testing.assert_array_equal(np.isnan(values[:, 0]) & np.isfinite((green, yellow)[name == "yellow"][:, 0]),
                                      np.array(status[name]) != OK)  # fmt: skip
    return [set(status[name]) for name in ("green", "yellow")]


def test_what_no_mark_of_the_robot_can_be_is_taken_out_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    absent = np.full((COUNT, 2), np.nan)
    body = circle(), circle(60.0)
    assert impossible(*body, monkeypatch) == [{OK}, {OK}]
    assert impossible(REST, circle(), monkeypatch) == [{BACKGROUND}, {OK}]
    assert impossible(circle(), REST, monkeypatch) == [{OK}, {BACKGROUND}]
    assert impossible(REST, absent, monkeypatch) == [{ALONE}, {OK}]
    jumped = circle()
    jumped[60:63] += 40.0
    assert impossible(jumped, circle(60.0), monkeypatch) == [{OK, OFF_COURSE}, {OK}]
    stranger = circle(80.0, -0.03)
    stranger[:50] = np.nan  # the rarer of two that move as they like is none of the body's
    assert impossible(circle(), stranger, monkeypatch) == [{OK}, {OK, STRANGER}]
    assert impossible(stranger, circle(), monkeypatch) == [{OK, STRANGER}, {OK}]


@pytest.mark.parametrize(("noise", "times"), [(0.03, 9.0), (0.005, 1.0)])
def test_marks_of_a_body_are_as_unsure_as_their_distance_scatters_and_no_surer(
    noise: float, times: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = combine._hold_together
    only(monkeypatch, _hold_together=keep)
    places = {"green": circle(), "yellow": circle(60.0), "blue": circle(60.0, phase=1.5)}
    numbers = {name: numbers_of(where, noise=noise, seed=k) for k, (name, where) in enumerate(places.items())}
    before = {name: values.copy() for name, values in numbers.items()}
    numbers["green"][70, :2] += 20 * noise * np.array([np.cos(1.4), np.sin(1.4)])  # outward, along the line
    status = refined(numbers, body=("green", "yellow"))
    assert np.flatnonzero(np.array(status["green"]) == WRONG_DISTANCE).tolist() == [70]
    for name in ("green", "yellow"):
        there = np.isfinite(numbers[name][:, 0])
        ratio = (numbers[name] / before[name])[there, 2:5]
        np.testing.assert_allclose(ratio, ratio[0, 0])
        assert ratio[0, 0] == pytest.approx(times, rel=0.3 if times > 1 else 1e-9)
    np.testing.assert_array_equal(numbers["blue"], before["blue"])  # is on no body


def test_the_partner_of_a_mark_is_the_one_that_is_seen_most() -> None:
    seldom = numbers_of(circle(30.0))
    seldom[::2] = np.nan
    numbers = {"green": numbers_of(circle()), "blue": seldom, "yellow": numbers_of(circle(60.0))}
    apart = combine._apart(numbers, "green", ["green", "blue", "yellow"])
    assert apart is not None
    np.testing.assert_allclose(apart, 40.0)
    assert combine._apart(numbers, "green", ["green"]) is None
    assert combine._apart(numbers, "green", ["blue", "yellow"]) is None


def test_a_body_starts_and_stops_with_two_marks_and_repeated_frames_tell_nothing_of_it() -> None:
    set_off = np.stack([2.0 * np.maximum(np.arange(COUNT) - 100.0, 0.0), np.zeros(COUNT)], axis=1)
    noise = np.random.default_rng(3).normal(size=(2, COUNT, 2))
    marks = [numbers_of(set_off + [0.0, 30.0 * k] + 0.01 * noise[k]) for k in range(2)]
    new = np.ones(COUNT, bool)
    new[20:40] = False
    found = combine._kinks(TIME_S, marks, new)
    assert found is not None
    assert np.flatnonzero(found).tolist() == [100]
    assert np.flatnonzero(around(found)).tolist() == list(range(95, 106))
    assert combine._kinks(TIME_S, marks[:1], new) is None


def test_frames_that_a_codec_predicts_err_along_a_change_of_the_motion() -> None:
    """132 starts of marks in films: by 0.22 of the motion in a frame at the change and beside it, 0.11 next to that."""
    path = np.maximum(np.arange(40.0) - 20.0, 0.0)[:, None] * [0.6, -0.8]
    bent = np.arange(40) == 20
    kinds = np.full(40, "P")
    kinds[22] = "I"
    extra = smeared(path, bent, kinds)
    assert np.flatnonzero(extra[:, 0]).tolist() == [18, 19, 20, 21]
    shares = np.array([0.11, 0.22, 0.22, 0.22])
    assert extra[18:22] == pytest.approx(np.outer(shares**2, [0.36, 0.64, -0.48]))
    assert not smeared(path, bent, np.full(40, "I")).any()
    assert not smeared(path, bent, np.full(40, "")).any()  # of images
    lost = np.where(np.arange(40)[:, None] == 25, np.nan, path)
    assert not smeared(lost, bent, np.full(40, "P")).any()
    late = smeared(path, np.arange(40) == 39, np.full(40, "B"))
    assert np.flatnonzero(late[:, 0]).tolist() == [37, 38, 39]


@pytest.mark.parametrize(("radius", "speed"), [(150.0, 2.0), (40.0, 0.5), (300.0, 6.0), (5.0, 0.5)])
def test_a_course_follows_a_circle_over_the_frames_that_leave_a_hundredth_of_a_pixel(
    radius: float, speed: float
) -> None:
    """Of the circle, beside the polynomial of fourth degree with its derivatives; but over 6 px in any case."""
    turn = speed / radius

    def left(frames: float) -> float:
        polynomial = np.polynomial.polynomial.polyval(1j * turn * frames, [1 / math.factorial(n) for n in range(5)])
        return float(radius * abs(np.exp(1j * turn * frames) - polynomial))

    expected = max(6.0 / speed, brentq(lambda frames: left(frames) - 0.01, 0.1, 1.5 / turn))
    chord = 2 * radius * np.sin(5 * turn / 2) / 5  # directions are those of chords over five frames
    assert straight_frames(circle(radius, turn)) == pytest.approx(expected, rel=0.02 + 1 - chord / speed)
    assert straight_frames(circle(radius, turn)[:9]) == np.inf


def test_a_variance_of_fewer_than_24_errors_is_unknown_and_its_error_falls_with_the_root_of_their_number() -> None:
    """Errors of ±0.2 px in turn, each of which has half as much variance again from its neighbours."""
    course: Any = SimpleNamespace(
        error=0.2 * (-1.0) ** np.add.outer(np.arange(100), np.arange(2)), squares=np.full((10, 100), 0.05)
    )
    told = np.arange(100) < 25
    assert _square(course, told) == pytest.approx((0.04 / 1.5, 0.2))
    told[0] = told[1] = False
    assert _square(course, told) == (0.0, 1.0)


def test_hidden_errors_are_estimated_anew_in_every_block_of_a_long_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(combine, "BLOCK", COUNT // 2)
    quiet, noisy = (numbers_of(circle(), noise=noise) for noise in (0.01, 0.2))
    numbers = {"green": np.concatenate([quiet[: COUNT // 2], noisy[COUNT // 2 :]])}
    refined(numbers)
    first, second = np.split(np.median(numbers["green"][:, 2].reshape(2, -1), axis=1), 2)
    assert first < 4 * 0.01**2
    assert 0.5 * 0.2**2 < second < 2 * 0.2**2


def test_memory_of_hidden_errors_does_not_grow_with_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(combine, "BLOCK", COUNT)

    def bytes_a_frame(count: int) -> float:
        """Beyond what the recording itself holds."""
        numbers = {"green": np.tile(numbers_of(circle(), noise=0.02), (count // COUNT, 1))}
        tracemalloc.start()
        combine.refine(FRAME_S * np.arange(count), ["P"] * count, numbers, {"green": [OK] * count}, {})
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak / count

    assert bytes_a_frame(COUNT) > 1000
    assert bytes_a_frame(20 * COUNT) < 400


def test_only_repetitions_that_were_left_out_are_told() -> None:
    """A scene at rest, which a codec repeats to the bit, was said to need another frame rate, in seven of ten films."""
    table = pd.DataFrame({"frame": range(4), "green_status": "ok", "yellow_status": "ok"})
    assert repeated_note(table) == ""
    table.loc[2, "green_status"] = REPEATED
    assert repeated_note(table).startswith("1 frame shows the one before again, the first is frame 2; it is left out")
    table.loc[[1, 2], "yellow_status"] = REPEATED
    assert repeated_note(table).startswith("2 frames show the one before again, the first is frame 1; they are left")
