"""How one mark is followed: its turns, its shutter, what is refused of a fit and why; each limit from either side.

Nothing is fitted here: what a fit found is put where the follower reads it.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.detection.appearance import Appearance
from evaluator.tracking.following import follow
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.motion import beyond
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.refinement import fast_path, kernels
from evaluator.tracking.refinement.disc import make_disc
from evaluator.tracking.refinement.shutter import best_share

DISC = make_disc(8.0, 0.9, (0.0, 0.0), (120.0, 40.0), 4.0)
COLOR = np.array([128.0, 128.0, 0.6, -0.8, 20.0, 0.7])
AREA = 200.0


def at(x: float, y: float) -> Sighting:
    return Sighting(x, y, 1e-4, 1e-4, 0.0, OK)


def frame(time_s: float = 0.0, index: int = 0) -> Any:
    return SimpleNamespace(size_px=(100, 80), time_s=time_s, index=index, luma=None, row_origin=0, row_step=1)


def follower(exposure: float | None = 0.5, **said: Any) -> Follower:
    one = Follower(Appearance(COLOR.copy(), AREA, DISC), exposure)
    for name, value in said.items():
        setattr(one, name, value)
    return one


@pytest.mark.parametrize(
    ("place", "cut"),
    [((5.1, 40), False), ((4.9, 40), True), ((50, 4.9), True), ((93.9, 74 - 0.1), False), ((94.1, 40), True),
     ((50, 74.1), True)],
)  # fmt: skip
def test_a_mark_is_cut_by_a_border_within_its_radius(place: tuple[float, float], cut: bool) -> None:
    assert beyond(frame(), place, 5.0) == cut


@pytest.mark.parametrize(("size", "turning"), [(1.0, True), (1.9, True), (0.52, True), (2.1, False), (0.48, False)])
def test_velocity_turns_as_it_turned_last_unless_its_size_doubles_or_halves(size: float, turning: bool) -> None:
    before, angle = (90.0, 0.0), 0.1
    one = follower(velocity=(size * 90 * math.cos(angle), size * 90 * math.sin(angle)))
    assert one._turn(before, 0.05) == pytest.approx(2.0 if turning else 0.0)
    assert one._turn(before, 0.018 / size) == 0.0  # less than 2 px in a step are no turn
    one.turn_rad_s = -2.0
    assert one._turned((3.0, 4.0), math.pi / 4) == pytest.approx((4.0, -3.0))
    one.turn_rad_s = 0.0
    assert one._turned((3.0, 4.0), 1.0) == (3.0, 4.0)


def test_share_of_the_shutter_is_the_bottom_of_the_parabola_through_the_least_residual() -> None:
    def around(true: float) -> Any:
        return lambda share: 3 + (share - true) ** 2

    assert best_share(around(0.42)) == pytest.approx(0.42)
    assert best_share(around(0.55)) == pytest.approx(0.55)
    assert best_share(lambda share: share) == 0.1
    assert best_share(lambda share: -share) == 1.0
    assert best_share(lambda share: math.nan if share == 0.3 else around(0.42)(share)) == 0.5


def exposed(one: Follower, monkeypatch: pytest.MonkeyPatch, true: tuple[float, float]) -> float:
    """Learn the shutter of a mark whose residual grows with the square of what its smear is off the true one."""
    smeared: list[tuple[float, float]] = []
    monkeypatch.setattr(fast_path, "smear", lambda _, x, y: smeared.append((x, y)))

    def fit(*_: object) -> None:
        one._result[kernels.RESIDUAL] = 1.0 + sum((a - b) ** 2 for a, b in zip(smeared[-1], true, strict=True))

    monkeypatch.setattr(one._slow_path, "fit", fit)
    return one._learn_exposure(frame(1.1), np.zeros(4), 0.1)


def test_share_that_the_shutter_is_open_is_that_of_the_smear_over_the_way_between_frames(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = follower(None, position=(10.0, 20.0), time_s=1.0, velocity=(999.0, 999.0))
    assert one.shutter == (0.5, pytest.approx(1 / math.sqrt(12)))  # any share is as likely
    one._result[:2] = 14.0, 17.0  # 5 px on
    assert exposed(one, monkeypatch, (4 * 0.35, -3 * 0.35)) == pytest.approx(1.0)
    assert one.shutter == pytest.approx((0.35, 0.2 / math.sqrt(12)))
    missed = follower(None, position=(10.0, 20.0), time_s=1.0, velocity=(40.0, -30.0), missed=1)
    missed._result[:2] = 99.0, 99.0
    assert exposed(missed, monkeypatch, (4 * 0.75, -3 * 0.75)) == pytest.approx(1.0)
    assert missed.shutter[0] == pytest.approx(0.75)


@pytest.mark.parametrize(("way_px", "learnt"), [(1.9, False), (2.1, True)])
def test_a_shutter_is_learnt_from_motion_of_two_pixels_on(
    way_px: float, learnt: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = follower(None, position=(10.0, 20.0), time_s=1.0)
    one._result[:2] = 10.0 + way_px / 2, 20.0 + way_px / 2
    one._result[kernels.RESIDUAL] = 7.0
    assert exposed(one, monkeypatch, (way_px / 4, way_px / 4)) == pytest.approx(1.0 if learnt else 7.0)


def found(**said: float) -> Follower:
    """A follower whose last fit is sound at (50, 40) but for what is said."""
    usual = {"X": 50.0, "Y": 40.0, "AMPLITUDE": 120.0, "VAR_X": 1e-4, "VAR_Y": 2e-4, "COV_XY": 5e-5, "RESIDUAL": 1.0,
             "USED": 1.0, "INSIDE": 1.0, "PIXELS": 200.0}  # fmt: skip
    one = follower()
    for name, value in (usual | {key: value for key, value in said.items() if key.isupper()}).items():
        one._result[getattr(kernels, name)] = value
    one._found[:3] = said.get("colored", AREA), said.get("seen_x", 50.0), said.get("seen_y", 40.0)
    return one


@pytest.mark.parametrize(
    ("said", "status"),
    [
        ({}, OK),
        ({"X": math.nan}, "no disc"),
        ({"INSIDE": 0.91}, OK),
        ({"INSIDE": 0.89}, "outside the image"),
        ({"USED": 0.76}, OK),
        ({"USED": 0.74}, "partly hidden"),
        ({"RESIDUAL": 7.9}, OK),
        ({"RESIDUAL": 8.1}, "disturbed"),
        ({"AMPLITUDE": 479.0}, OK),
        ({"AMPLITUDE": 481.0}, "no disc"),
        ({"AMPLITUDE": 30.1}, OK),
        ({"AMPLITUDE": 29.9}, "no disc"),
        # Within reach of 3 px and half a radius and a pixel more, of the place and of where its colour is.
        ({"X": 57.9, "seen_x": 57.9}, OK),
        ({"X": 58.1, "seen_x": 58.1}, "no disc"),
        ({"Y": 31.9, "seen_y": 31.9}, "no disc"),
        ({"seen_x": 53.0, "seen_y": 41.9}, OK),
        ({"seen_x": 53.0, "seen_y": 42.1}, "crowded"),
        ({"seen_x": 47.0, "seen_y": 37.9}, "crowded"),
        ({"colored": 299.0}, OK),
        ({"colored": 301.0}, "crowded"),
    ],
)
def test_a_fit_that_is_no_mark_is_refused_with_its_reason(
    said: dict[str, float], status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = found(**said)
    monkeypatch.setattr(one, "_crowd", lambda *_: "ambiguous")
    monkeypatch.setattr(follow, "rim_power", lambda *_: (math.nan, math.nan))
    judged = one._judged(frame(), np.zeros(4), (50.0, 40.0), 3.0).status
    assert judged == ("ambiguous" if status == "crowded" else status)


@pytest.mark.parametrize(
    ("around", "reason"),
    [((99.0, 50.0, 40.0), "partly hidden"), ((101.0, 50.0, 40.0), ""), ((200.0, 52.0, 37.2), ""),
     ((200.0, 52.0, 36.8), "ambiguous"), ((200.0, 48.0, 43.2), "ambiguous")],
)  # fmt: skip
def test_colour_around_a_mark_tells_whether_half_of_it_is_hidden_or_something_is_beside_it(
    around: tuple[float, float, float], reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = follower()
    monkeypatch.setattr(follow.color_kernels, "color_window", lambda *_: one._found.__setitem__(slice(3), around))
    blank = SimpleNamespace(u=None, v=None)
    assert one._crowd(blank, np.zeros(4), (50.0, 40.0), 5.0) == reason  # type: ignore[arg-type]


def variances(one: Follower) -> tuple[float, float, float]:
    measured = one._measured(frame(), np.full(4, 2.0))
    return measured.var_x, measured.var_y, measured.cov_xy


def test_residuals_above_the_noise_widen_a_centre_and_a_slope_that_was_not_taken_out_adds_its_shift() -> None:
    stated = np.array([1e-4, 2e-4, 5e-5])
    assert variances(found(RESIDUAL=0.8)) == pytest.approx(stated)
    assert variances(found(RESIDUAL=1.09)) == pytest.approx(stated)  # of 200 pixels it scatters by a tenth
    assert variances(found(RESIDUAL=1.4)) == pytest.approx(1.3 * stated)
    # Beyond what is usual a ninth of the pixels may pull one way.
    assert variances(found(RESIDUAL=1.7)) == pytest.approx((1.6 + 0.11 * 200 * 0.2) * stated)
    shifted = found(RESIDUAL=1.4)
    shifted._slow_path.shift = 0.03, -0.02
    assert variances(shifted) == pytest.approx(1.3 * stated + [9e-4, 4e-4, -6e-4])
    shifted.rim.extra_px2 = 1e-3
    assert variances(shifted) == pytest.approx(1.3 * stated + [19e-4, 14e-4, -6e-4])
    occluded = found(RESIDUAL=5.0)
    occluded._slow_path.occluded = True
    assert variances(occluded) == pytest.approx(stated)
    # An end of a smear of (6, -8) px tells where its middle is to half of what its length is unsure by.
    occluded._disc[5:7] = 6.0, -8.0
    assert variances(occluded) == pytest.approx(stated)  # said: half of the interval
    occluded.shutter = 0.5, 0.05
    assert np.subtract(variances(occluded), stated) == pytest.approx([0.3**2, 0.4**2, -0.3 * 0.4])
    occluded.shutter = 0.0, 0.0
    assert variances(occluded) == pytest.approx(stated)


def test_what_a_rim_tells_is_held_against_the_mean_variance_of_both_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    noted: list[Any] = []
    one = found(RESIDUAL=1.4)
    monkeypatch.setattr(follow, "rim_power", lambda *_: "power")
    monkeypatch.setattr(one.rim, "note", lambda *said: noted.append(said))
    one._measured(frame(), np.full(4, 2.0), with_rim=True)
    assert noted == [("power", pytest.approx(1.3 * 1.5e-4))]


def tried(one: Follower, monkeypatch: pytest.MonkeyPatch, guide: tuple[float, float], **said: Any) -> list[Any]:
    """Velocities with which a lost mark is looked for at (30, 20) at 1.1 s, and its colour and light then."""
    seen = []

    def look_at(*_: object) -> Sighting:
        seen.append((one.velocity, float(one.color[4]), one._usual[:2].tolist(), one.turn_rad_s))
        return said.get("outcome", ABSENT["no disc"])

    monkeypatch.setattr(one, "look_at", look_at)
    one.look_again(frame(1.1), np.zeros(4), (30.0, 20.0), 0.1, guide, said.get("light", 1.0))
    return seen


def test_a_lost_mark_is_looked_for_as_fast_as_it_came_here_as_its_body_is_and_at_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = follower(position=(10.0, 20.0), time_s=1.0, velocity=(5.0, 6.0), turn_rad_s=0.7)
    assert [velocity for velocity, *_ in tried(one, monkeypatch, (1.0, 2.0))] == [
        (pytest.approx(200.0), 0.0), (1.0, 2.0), (0.0, 0.0),
    ]  # fmt: skip
    assert (one.velocity, one.turn_rad_s) == ((5.0, 6.0), 0.7)
    one.last_sighting = (30.0, 10.0), 1.0
    assert next(iter(tried(one, monkeypatch, (0.0, 0.0))))[0] == (0.0, pytest.approx(100.0))
    late = follower(position=(10.0, 20.0), time_s=0.69)  # more than four intervals ago
    assert [velocity for velocity, *_ in tried(late, monkeypatch, (0.0, 0.0))] == [(0.0, 0.0)]
    assert len(tried(one, monkeypatch, (1.0, 2.0), outcome=at(30.0, 20.0))) == 1


@pytest.mark.parametrize(
    ("light", "color", "luma"), [(0.5, 10.0, 60.0), (0.85, 17.0, 120.0), (1.1, 20.0, 120.0), (1.5, 20.0, 180.0)]
)
def test_a_mark_that_was_lost_as_the_light_changed_is_as_bright_as_all_has_become(
    light: float, color: float, luma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = follower(turn_rad_s=0.7)
    usual = one._usual.copy()
    ((_, strength, (amplitude, base), turning),) = tried(one, monkeypatch, (0.0, 0.0), light=light)
    assert (strength, amplitude, base, turning) == pytest.approx((color, luma, luma / 3, 0.0))
    assert one.color[4] == 20.0
    np.testing.assert_array_equal(one._usual, usual)
    tried(one, monkeypatch, (0.0, 0.0), light=light, outcome=at(30.0, 20.0))
    assert one._usual[0] == pytest.approx(luma)  # found so, it stays so


def test_a_shape_is_learnt_anew_where_noise_is_no_longer_what_it_was() -> None:
    for ratio, changed in ((0.59, True), (0.61, False), (1.59, False), (1.61, True)):
        one = follower()
        one._noise[0] *= ratio
        assert one.looks_changed() == changed
    one._usual[:2], one._noise[0] = (90.0, 30.0), 9.0
    one.take_shape(Appearance(COLOR, AREA, make_disc(7.0, 0.9, (0.0, 0.0), (120.0, 40.0), 4.0)))
    assert (*one._usual[:2], one._noise[0], one.radius_px) == (90.0, 30.0, 9.0, 7.0)


@pytest.mark.parametrize(("step_px", "smeared"), [(1.9, False), (2.1, True)])
def test_no_edge_is_looked_for_beside_a_mark_that_is_smeared_while_it_is_learnt(
    step_px: float, smeared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = list[Any]()
    monkeypatch.setattr(follow, "learn_shape", lambda *_, smeared: told.append(smeared))
    follower(velocity=(60.0 * step_px, 0.0)).learn_anew([], 1 / 60)
    assert told == [smeared]


def test_every_tenth_clear_view_is_kept_before_the_last_lesson(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(follow, "patch_of", lambda _, place, radius: (place, radius))
    one = follower(position=(50.0, 40.0))
    one._result[kernels.RESIDUAL] = 1.4
    for _ in range(300):
        one.keep_view(frame())
    views: list[Any] = one.views
    assert views == [((50.0, 40.0), 8.0)] * 23  # up to 239
    one.seen, one._result[kernels.RESIDUAL] = 0, 1.6
    for _ in range(20):
        one.keep_view(frame())
    assert len(one.views) == 23


@pytest.mark.parametrize(
    ("said", "noted"), [({}, True), ({"missed": 1}, False), ({"slope": 0.1}, False), ({"occluded": True}, False)]
)
def test_light_is_noted_on_a_mark_that_is_seen_plainly(
    said: dict[str, Any], noted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, places = follower(position=(50.0, 40.0), missed=said.get("missed", 0)), list[Any]()
    monkeypatch.setattr(one.light, "note", lambda _, place, known: places.append((place, known)))
    one._slow_path.occluded = said.get("occluded", False)
    one._fitted[kernels.SLOPE_X] = said.get("slope", 0.0)
    one.note_light(frame())
    assert places == [((50.0, 40.0), (0.0, 0.0))] * noted


def test_what_is_usual_of_a_mark_follows_slow_changes_by_a_tenth_and_jumps_at_once() -> None:
    for measured, amplitude in ((140.0, 122.0), (101.0, 118.1), (145.0, 145.0), (99.0, 99.0)):
        one = found(AMPLITUDE=measured, BASE=50.0)
        one._found[3:] = 44.0  # twice the strength of its colour
        fast_path.settle(one._usual, one._noise, one.color, one._found, one._result)
        assert one._usual[0] == pytest.approx(amplitude)
        assert one._usual[1] == pytest.approx(41.0 if abs(amplitude - 120) < 3 else 50.0)
        assert one.color[4] == pytest.approx(20.2)


@pytest.mark.parametrize(("residual", "step"), [(1.2, 1.03), (0.8, 1 / 1.03), (0.6, 0.7)])
def test_noise_steps_toward_the_median_of_residuals_within_its_range(residual: float, step: float) -> None:
    one = found(RESIDUAL=residual)
    fast_path.settle(one._usual, one._noise, one.color, one._found, one._result)
    assert one._noise[0] == pytest.approx(4.0 * step)
    for start, end in ((2.0, max(2.0 * step, 2.0)), (60.0, min(60.0 * step, 60.0))):  # of a least noise of 2
        one._noise[0] = start
        fast_path.settle(one._usual, one._noise, one.color, one._found, one._result)
        assert one._noise[0] == pytest.approx(end)
    assert one._usual[fast_path.U_SCATTER] <= 0.5 / 3
    for _ in range(99):
        fast_path.settle(one._usual, one._noise, one.color, found(RESIDUAL=1.0)._found, found(RESIDUAL=1.0)._result)
    assert one._usual[fast_path.U_SCATTER] == pytest.approx(0.1)  # chance of 200 pixels
