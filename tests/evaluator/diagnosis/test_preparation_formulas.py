"""How a problem is prepared from runs: shifts by what is fitted, the first seconds, terms without influence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood import preparation
from evaluator.diagnosis.likelihood.features import channel_residual, channels_of, compression
from evaluator.diagnosis.likelihood.noise.drift_evidence import OF_MARKS, OF_POSES
from evaluator.diagnosis.likelihood.noise.friction_wander import MODES
from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.preparation import friction_shifts, within_horizon
from evaluator.diagnosis.likelihood.run_data import Task
from simulator.command import Command
from simulator.effects.coordinates import Candidate, Coordinate

HALF_MM = 1.83


def marks_at(x: float, y: float, heading: float) -> np.ndarray:
    """Marks (9, 4) of a path that is moved and turned about the origin of the plate."""
    way = np.exp(1j * (heading + np.linspace(0.2, 1.0, 9))) * 6 + complex(x, y)
    across = 1j * HALF_MM * np.exp(1j * (heading + np.linspace(0.5, 1.3, 9)))
    return np.column_stack([(way + across).real, (way + across).imag, (way - across).real, (way - across).imag])


def test_shifts_by_a_start_are_those_of_a_path_that_is_moved_and_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of one moves the marks by 0.3 mm along x, a start one second later by −0.7 mm along y."""
    used = np.arange(9) != 4

    def marks(tasks: list[Task]) -> list[np.ndarray]:
        along_x, along_y = np.array([1, 0, 1, 0]), np.array([0, 1, 0, 1])
        moved = [0.3 * task.per_run[3] * along_x - 0.7 * task.per_run[6] * along_y for task in tasks]
        return [marks_at(0, 0, 0) + part for part in moved]

    robot: Any = SimpleNamespace(wheel_positions_mm=lambda: np.zeros((4, 2)))
    problem: Any = SimpleNamespace(
        per_run_steps=1e-3 * np.arange(1, 8), half_distance_mm=HALF_MM, compressions=[SimpleNamespace(used=used)],
        forward=SimpleNamespace(robots=[robot], marks=marks),
    )  # fmt: skip
    monkeypatch.setattr(preparation, "wheel_friction", lambda count: () if count == 4 else None)
    monkeypatch.setattr(preparation, "wheel_paths", lambda *_: None)
    monkeypatch.setattr(preparation, "wander_shifts", lambda *_: np.ones((MODES, 9, 4)))
    ((known, wander),) = friction_shifts(problem, Point(np.zeros((1, 7))), [0])
    base = channels_of(marks_at(0, 0, 0))
    for number, step in enumerate(1e-6 * np.eye(3)):
        moved = channel_residual(channels_of(marks_at(*step)), base, HALF_MM) / 1e-6
        np.testing.assert_allclose(known[number], moved[used], atol=1e-4)
    np.testing.assert_allclose(known[3], np.tile([0.3, 0, 0, 0], (8, 1)), atol=1e-9)
    np.testing.assert_allclose(known[4:6], 0, atol=1e-9)
    np.testing.assert_allclose(known[6], np.tile([0, -0.7, 0, 0], (8, 1)), atol=1e-9)
    assert wander.shape == (MODES, 8, 4)


def test_a_run_that_cannot_be_simulated_is_shifted_by_nothing() -> None:
    used = np.arange(9) != 4
    robot: Any = SimpleNamespace(wheel_positions_mm=lambda: np.zeros((4, 2)))
    forward: Any = SimpleNamespace(robots=[robot], marks=lambda tasks: [np.full((9, 4), np.nan)] * len(tasks))
    problem: Any = SimpleNamespace(
        per_run_steps=np.full(7, 1e-3), half_distance_mm=HALF_MM, compressions=[SimpleNamespace(used=used)],
        forward=forward,
    )  # fmt: skip
    ((known, wander),) = friction_shifts(problem, Point(np.zeros((1, 7))), [0])
    assert (known.shape, wander.shape) == ((7, 8, 4), (MODES, 8, 4))
    assert not known.any()
    assert not wander.any()


def test_noise_cannot_be_estimated_at_a_point_from_which_a_run_cannot_be_simulated() -> None:
    left_over = [np.zeros((9, 4)), np.full((9, 4), np.nan)]
    problem: Any = SimpleNamespace(
        data=[SimpleNamespace(id=name) for name in ("r01", "r02")], residuals=lambda _: left_over
    )
    with pytest.raises(FloatingPointError, match="run r02 cannot be simulated"):
        preparation.with_noise_of(problem, Point(np.zeros((2, 7))))


@pytest.mark.parametrize(("effect", "unit"), [(3, 1.0), (4, 0.2), (5, 0.2)])  # friction and gains, with their scatter
@pytest.mark.parametrize(("moved_mm", "left_of_it"), [(1.0, (0.0, 0.01)), (0.002, (0.95, 1.05))])
def test_varying_friction_is_not_outweighed_by_a_random_effect_beyond_the_usual(
    moved_mm: float, left_of_it: tuple[float, float], effect: int, unit: float
) -> None:
    """A shift by varying friction that looks like a random effect, of a run that one unit of it moves by moved_mm.

    0.02 mm of it are 2 % of the friction, or ten times that friction.
    """
    time_s = np.arange(120) / 60
    seen = compression(time_s, np.ones(120, dtype=bool), (Noise(0.005, 0.0, 0.1),) * 4)
    form = np.zeros((120, 4))
    form[:, 0] = np.sin(3 * time_s)
    known = np.zeros((7, 120, 4))
    known[0, :, 0] = known[1, :, 1] = known[2, :, 2] = 1.0
    known[effect] = moved_mm * form / unit
    about_mean = 0.02 * (form - form.mean(axis=0))
    left = preparation._midpoint_about(seen, 0.02 * form[None], known)
    low, high = left_of_it
    assert low <= left / np.sqrt(np.mean(about_mean[:, 0] ** 2)) <= high


@pytest.mark.parametrize("open_ground", [False, True])
def test_noise_is_that_of_the_frames_up_to_the_last_that_counts_with_its_drifts(
    monkeypatch: pytest.MonkeyPatch, *, open_ground: bool
) -> None:
    asked: list[Any] = []
    command = Command([3.0], [240.0], [240.0])
    run: Any = SimpleNamespace(
        time_s=np.arange(40.0), start_s=3.0, from_poses=False, marks_mm=np.zeros((40, 4)),
        run_command=SimpleNamespace(command=command),
    )  # fmt: skip
    problem: Any = SimpleNamespace(
        data=[run], channels=[np.zeros((40, 4))], counting_frames=lambda _: np.isin(np.arange(40), [3, 4, 29]),
        residuals=lambda tasks: [np.arange(160.0).reshape(40, 4) for _ in tasks], open_ground=open_ground, length=1.0,
        common_drift=Drift(0.1), friction_wander=0.0, change_sigma_s=0.0, field_of_view=7.0, drifting_axes=OF_MARKS,
    )  # fmt: skip
    drifting = tuple(Noise(size, 0.0, 0.1, Drift(0.01)) for size in (1.0, 1.0, 3.0, 4.0))
    monkeypatch.setattr(preparation, "replace", replaced)
    monkeypatch.setattr(preparation, "residual_spectra", lambda *said: asked.append(said))
    monkeypatch.setattr(preparation, "channel_noise", lambda _: ["of spectra"])

    def with_drift(noise: Any, *given: Any) -> Any:
        asked.append(given[-1])
        return [drifting] if noise == ["of spectra"] else None

    monkeypatch.setattr(preparation, "with_drift", with_drift)
    monkeypatch.setattr(preparation, "compression", lambda *said: said)
    monkeypatch.setattr(preparation, "_left_over", lambda *_: None)
    monkeypatch.setattr(preparation, "with_discrepancy", lambda noise, *_: noise)
    found = preparation.with_noise_of(problem, Point(np.zeros((1, 7))))
    (time_s, residual_mm, since_s, bands), field = asked
    assert field == 7.0
    assert (len(time_s), residual_mm.shape, since_s) == (30, (30, 4), 3.0 + preparation.SETTLING_S)
    np.testing.assert_allclose(bands, [] if open_ground else [(4 - 2 / 26, 4 + 2 / 26)])
    both = tuple(replace(part, common_drift=Drift(0.1)) for part in drifting[:2])  # of the midpoint alone
    assert found.noise == ((*both, *drifting[2:]),)
    problem.drifting_axes = OF_POSES  # of the heading in proportion to its noise
    asked.clear()
    turning = preparation.with_noise_of(problem, Point(np.zeros((1, 7)))).noise[0]
    assert (turning[:2], turning[3]) == (both, drifting[3])
    assert turning[2].common_drift.size_mm == pytest.approx(0.1 * drifting[2].sigma_mm / drifting[0].sigma_mm)
    assert found.compressions[0][2:] == (found.noise[0], preparation.MODEL_FLOOR_MM, bands)


def test_marks_that_are_computed_from_poses_tell_nothing_by_their_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    rigid: list[Any] = []
    run: Any = SimpleNamespace(
        id="r01", time_s=np.arange(40.0), start_s=3.0, marks_mm=np.zeros((40, 4)),
        run_command=SimpleNamespace(command=Command([3.0], [2.0], [2.0])),
    )  # fmt: skip
    runs = [SimpleNamespace(**vars(run), from_poses=from_poses) for from_poses in (False, True)]
    used = np.arange(40) > 3
    problem: Any = SimpleNamespace(
        data=runs, channels=[np.zeros((40, 4))] * 2, counting_frames=lambda _: used, open_ground=False, length=1.0,
        residuals=lambda tasks: [np.zeros((40, 4)) for _ in tasks], common_drift=Drift(), friction_wander=0.0,
        change_sigma_s=0.0, field_of_view=1.0, drifting_axes=OF_MARKS,
    )  # fmt: skip
    noise = tuple(Noise(size, 0.0, 0.1) for size in (1.0, 2.0, 3.0, 4.0))
    monkeypatch.setattr(preparation, "replace", replaced)
    monkeypatch.setattr(preparation, "channel_noise", lambda spectra: [noise for _ in spectra])
    monkeypatch.setattr(preparation, "with_drift", lambda found, _, those, *__: (rigid.extend(those), found)[1])
    monkeypatch.setattr(preparation, "compression", lambda *said: said)
    found = preparation.with_noise_of(problem, Point(np.zeros((2, 7))))
    assert found.noise == (noise, (*noise[:3], replace(noise[3], white_mm=preparation.NO_DISTANCE_MM)))
    np.testing.assert_array_equal(rigid, [used, np.zeros(40)])


@pytest.mark.parametrize("walk", [0.0, 0.5])
def test_features_are_whitened_for_what_friction_wanders_by_its_rate_and_for_late_changes(
    walk: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    wander, more, known = rng.normal(size=(3, 7, 4)), rng.normal(size=(2, 7, 4)), rng.normal(size=(7, 7, 4))
    part: Any = SimpleNamespace(of_tracking=lambda shifts: shifts.sum(axis=1), ground=None, random_mm=0.0)
    problem: Any = SimpleNamespace(data=[None], compressions=[part], friction_wander=walk, change_sigma_s=0.1)
    monkeypatch.setattr(preparation, "replace", replaced)
    monkeypatch.setattr(preparation, "late_shifts", lambda *_: [more])
    monkeypatch.setattr(preparation, "friction_shifts", lambda *_: [(known, wander)])
    monkeypatch.setattr(preparation, "whitening", lambda columns: columns)
    (found,) = preparation._with_random_shifts(problem, Point(np.zeros((1, 7)))).compressions
    shifts = np.concatenate([walk * wander, more])[0 if walk else 3 :]
    np.testing.assert_allclose(found.ground, shifts.sum(axis=1).T)
    assert found.random_mm == preparation._midpoint_about(part, shifts, known)


def replaced(item: Any, **more: Any) -> Any:
    """An item, a dataclass or a stand-in of one, with other values."""
    return SimpleNamespace(**{**vars(item), **more}) if isinstance(item, SimpleNamespace) else replace(item, **more)


def test_the_first_seconds_of_runs_end_with_the_last_frame_that_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    counting = [np.arange(20) < 7, np.isin(np.arange(20), [3, 4, 11])]
    runs = [SimpleNamespace(first=lambda count, run=run: (run, count)) for run in range(2)]
    problem: Any = SimpleNamespace(
        data=runs, channels=[np.arange(20), np.arange(20)], counting_frames=lambda run: counting[run],
        forward=SimpleNamespace(of_frames=lambda data: ("forward", data)),
    )  # fmt: skip
    monkeypatch.setattr(preparation, "replace", lambda item, **more: SimpleNamespace(**{**vars(item), **more}))
    monkeypatch.setattr(preparation, "with_noise_of", lambda short, point: (short, point))
    short, point = within_horizon(problem, "point", 2.5)  # type: ignore[arg-type, misc]
    assert (point, short.horizon_s) == ("point", 2.5)
    assert short.data == ((0, 7), (1, 12))
    assert [item.tolist() for item in short.channels] == [list(range(7)), list(range(12))]
    assert short.forward == ("forward", ((0, 7), (1, 12)))


def test_terms_that_change_nothing_are_left_out_of_a_point_where_they_are_columns() -> None:
    term = Candidate("line", (Coordinate("size", 0.0, 1.0),), dict)
    other = Candidate("other", (Coordinate("factor", 1.0, 0.1),), dict)
    columns = (Column("key"), Column("line", 0, term), Column("other", 0, other))
    point = Point(np.zeros((1, 7)), {"key": 0.5}, {"line": (0.0,), "other": (1.2,), "third": (0.0,)})
    found = point.without_absent(columns)
    assert (found.terms, found.nominal) == ({"other": (1.2,), "third": (0.0,)}, {"key": 0.5})
    assert found.without_absent(columns) is found
    assert Point(point.per_run, {}, {"other": (1.0,)}).without_absent(columns).terms == {}
