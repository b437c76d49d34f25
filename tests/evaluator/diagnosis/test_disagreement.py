"""Where measurement and model disagree: velocities, regressors, errors and sentences."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from evaluator.diagnosis.assessment.residuals import disagreement
from evaluator.diagnosis.assessment.residuals.disagreement import (
    QUANTITIES,
    SHOWN_SIGMAS,
    Dependence,
    _velocity_misfit,
    dependences,
    every_dependence,
    most_telling,
    pieces,
    root_mean_squares,
)
from evaluator.diagnosis.likelihood.features import channels_of
from evaluator.diagnosis.likelihood.run_data import RunData


def test_velocity_misfit_is_along_and_across_the_robot_and_each_in_its_own_frame() -> None:
    """A robot at 30 degrees measured 0.2 rad off its predicted heading, at the same speed in its frame: no misfit."""
    time = np.arange(20) / 20
    heading, turn, half = np.radians(30), 0.2, 1.8
    problem: Any = SimpleNamespace(half_distance_mm=half)

    def misfit(along: float, across: float, yaw: float, turned: float) -> tuple[float, float, float]:
        def velocity(ahead: float, left: float, at: float) -> np.ndarray:
            return np.array([np.cos(at) * ahead - np.sin(at) * left, np.sin(at) * ahead + np.cos(at) * left])

        measured = time[:, None] * velocity(2.0 + along, 0.5 + across, heading)
        predicted = time[:, None] * velocity(2.0, 0.5, heading - turned)
        channels = np.column_stack([measured, np.full(20, heading + np.pi / 2), np.full(20, 3.6)])
        off = half * (turned + yaw * (time - time.mean()))
        residual = np.column_stack([measured - predicted, off, np.zeros(20)])
        return _velocity_misfit(time, channels, residual, problem)

    assert misfit(0.0, 0.0, 0.0, turn) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert misfit(0.3, -0.1, 0.05, turn) == pytest.approx((0.3, -0.1, 0.05))
    assert misfit(0.3, -0.1, 0.05, 0.0) == pytest.approx((0.3, -0.1, 0.05))


def test_pieces_last_about_a_second_between_the_commands_and_know_their_run() -> None:
    time = np.arange(0, 5, 0.05)
    turned = 0.4 * time
    side = 2 * np.column_stack([-np.sin(turned), np.cos(turned)])
    middle = np.column_stack([3 + time, 7 - time])
    marks = np.concatenate([middle + side, middle - side], axis=1)
    run = RunData("r7", -30.0, -10.0, 0.5, 4.0, time, marks, 7)
    residual = np.zeros((100, 4))
    residual[:, 2] = 0.1 * time
    problem: Any = SimpleNamespace(
        data=[run], channels=[channels_of(marks)], residuals=lambda _: [residual], half_distance_mm=2.0
    )
    table = pieces(problem, cast("Any", SimpleNamespace(task=lambda number: number)))
    assert len(table) == 3  # 3.5 s
    third = 3.5 / 3
    np.testing.assert_allclose(table["time_s"], [third / 2, 1.5 * third, 2.5 * third])
    np.testing.assert_allclose(table["yaw_deg_s"], np.degrees(0.05))
    np.testing.assert_allclose(table["x_mm"], 3.5 + table["time_s"], atol=0.03)
    np.testing.assert_allclose(table["heading_deg"], np.degrees(0.4 * (0.5 + table["time_s"])), atol=1.0)
    (row,) = table.iloc[:1].to_dict("records")
    assert (row["run"], row["order"], row["direction"], row["side"]) == ("r7", 7, -1.0, 1.0)
    assert (row["speed_rpm"], row["difference_rpm"]) == (20.0, 20.0)
    alone = pieces(problem, cast("Any", SimpleNamespace(task=lambda number: number)), one_frame=False)
    assert alone[["heading_deg", "x_mm", "y_mm"]].isna().all(axis=None)  # poses in frames of their own have no place
    assert alone.drop(columns=["heading_deg", "x_mm", "y_mm"]).notna().all(axis=None)


def test_runs_in_frames_of_their_own_show_no_dependence_on_place_or_heading() -> None:
    table = disagreeing(along_mm_s=lambda row: 0.1 * row["x_mm"])
    assert {"place", "heading"} <= {item.by for item in every_dependence(table)}
    found = {item.by for item in every_dependence(table.assign(heading_deg=np.nan, x_mm=np.nan, y_mm=np.nan))}
    assert "speed" in found
    assert not [by for by in found if "place" in by or "heading" in by]


def disagreeing(**terms: Any) -> pd.DataFrame:
    """Pieces of sixteen runs, three each, with what depends on something as said, and noise of 1e-4 per run."""
    rng = np.random.default_rng(0)
    rows = []
    for run in range(16):
        direction, side = (-1.0) ** run, (-1.0) ** (run // 2)
        noise = 1e-4 * rng.normal(size=3)
        for piece in range(3):
            row = {
                "run": f"r{run}",
                "time_s": piece + 0.5,
                "direction": direction,
                "side": side,
                "speed_rpm": float(20 + 10 * (run % 3)),
                "difference_rpm": float(10 + 5 * (run // 4 % 3)),
                "heading_deg": float(rng.uniform(0, 360)),
                "x_mm": rng.uniform(-9, 9),
                "y_mm": rng.uniform(-9, 9),
                "order": run,
            }
            values = dict(zip(QUANTITIES, noise + 2e-5 * rng.normal(size=3), strict=True))
            for name, law in terms.items():
                values[name] += law(row)
            rows.append({**row, **values})
    return pd.DataFrame(rows)


LAWS: dict[tuple[str, str, str], tuple[Any, tuple[float, ...], str]] = {
    ("across_mm_s", "everywhere", "even"): (
        lambda _: 0.2,
        (0.2,),
        "measured sideways speed is off by +0.2 mm/s in all runs together",
    ),
    ("along_mm_s", "forward and backward", "odd"): (
        lambda row: 0.3 + 0.1 * row["direction"],
        (0.1,),
        "forward (faster) and +0.2 mm/s backward (slower)",
    ),
    ("yaw_deg_s", "left and right", "odd"): (
        lambda row: 0.3 * row["side"],
        (0.3,),
        "in left and -0.3 deg/s in right turns",
    ),
    ("along_mm_s", "left and right", "odd"): (
        lambda row: 0.3 * row["side"],
        (0.3,),
        "is off by +0.3 mm/s in left and -0.3 mm/s in right turns",
    ),
    ("yaw_deg_s", "forward and backward", "odd"): (
        lambda row: 0.3 * row["direction"],
        (0.3,),
        "is off by +0.3 deg/s forward and -0.3 deg/s backward",
    ),
    ("yaw_deg_s", "direction times side", ""): (
        lambda row: 0.3 * row["side"] * row["direction"],
        (0.3,),
        "is off by +0.3 deg/s in forward left and backward right turns, with the opposite sign in the others",
    ),
    ("along_mm_s", "speed", "odd"): (
        lambda row: 0.02 * row["direction"] * row["speed_rpm"],
        (0.02,),
        "+0.02 mm/s per rpm of mean wheel speed, with the opposite sign when driving backward",
    ),
    ("yaw_deg_s", "difference of the wheels", "odd"): (
        lambda row: 0.03 * row["side"] * row["difference_rpm"],
        (0.03,),
        "per rpm of difference of the wheel speeds, with the opposite sign in right turns",
    ),
    ("along_mm_s", "time since the command", ""): (
        lambda row: 0.1 * row["time_s"],
        (0.1,),
        "per second since the command",
    ),
    ("along_mm_s", "the first second", "odd"): (
        lambda row: 0.4 * row["direction"] * (row["time_s"] < 1),
        (0.4,),
        "in the first second after the command, with the opposite sign when driving backward",
    ),
}


@pytest.mark.parametrize(("key", "law"), LAWS.items(), ids=[f"{q} by {by}" for q, by, _ in LAWS])
def test_a_disagreement_is_found_with_what_it_depends_on_and_its_size(
    key: tuple[str, str, str], law: tuple[Any, tuple[float, ...], str]
) -> None:
    quantity, by, _ = key
    table = disagreeing(**{quantity: law[0]})
    (found,) = [d for d in every_dependence(table) if (d.quantity, d.by, d.parity) == key]
    assert [size[0] for size in found.sizes] == pytest.approx(list(law[1]), rel=0.01)
    assert all(low < value < high for value, low, high in found.sizes)
    assert found.sigmas > SHOWN_SIGMAS
    assert law[2] in found.sentence
    shown = dependences(table)
    assert (quantity, by) in [(item.quantity, item.by) for item in shown]
    assert [item.sigmas for item in shown] == sorted((item.sigmas for item in shown), reverse=True)
    assert all(item.sigmas >= 3.5 for item in shown)


@pytest.mark.parametrize("parity", ["even", "odd"])
def test_what_depends_on_heading_place_or_order_is_scaled_by_the_speed_and_odd_where_it_reverses(parity: str) -> None:
    mean = disagreeing()["speed_rpm"].mean()

    def sign(row: dict[str, float]) -> float:
        return float(row["direction"] if parity == "odd" else 1.0) * row["speed_rpm"] / mean

    def heading(row: dict[str, float]) -> float:
        return 0.2 * sign(row) * float(np.cos(2 * np.radians(row["heading_deg"] - 40)))

    found = {
        (d.by, d.parity): d for d in every_dependence(disagreeing(across_mm_s=heading)) if d.quantity == "across_mm_s"
    }
    wave = found["twice the heading", parity]
    assert np.hypot(*(size[0] for size in wave.sizes)) == pytest.approx(0.2, rel=0.05)
    assert "0.2 mm/s more at 40 and 220 degrees" in wave.sentence
    assert ("with the opposite sign when driving backward" in wave.sentence) == (parity == "odd")
    other = found["twice the heading", "odd" if parity == "even" else "even"]
    assert other.sigmas < wave.sigmas / 3

    def place(row: dict[str, float]) -> float:
        return sign(row) * (0.02 * row["x_mm"] - 0.03 * row["y_mm"])

    where = {
        (d.by, d.parity): d for d in every_dependence(disagreeing(across_mm_s=place)) if d.quantity == "across_mm_s"
    }
    assert [size[0] for size in where["place", parity].sizes] == pytest.approx([0.02, -0.03], rel=0.1)
    if parity == "odd":
        order = disagreeing(along_mm_s=lambda row: 0.02 * sign(row) * row["order"])
        (drift,) = [d for d in every_dependence(order) if (d.quantity, d.by) == ("along_mm_s", "order of the runs")]
        assert drift.sizes[0][0] == pytest.approx(0.02, rel=0.1)
        assert "+0.02 mm/s from each run to the next" in drift.sentence


def test_errors_of_a_mean_over_runs_are_those_of_student_and_pieces_of_a_run_add_nothing() -> None:
    """Of one value per run, repeated, the jackknife is the plain t test of the means."""
    rng = np.random.default_rng(3)
    values = 0.1 + 0.2 * rng.normal(size=8)
    table = disagreeing().iloc[:24].copy()
    table["run"] = np.repeat([f"r{n}" for n in range(8)], 3)
    table["along_mm_s"] = np.repeat(values, 3)
    (found,) = [d for d in every_dependence(table) if (d.quantity, d.by) == ("along_mm_s", "everywhere")]
    (size,) = found.sizes
    reach = stats.t.isf(0.025, 7) * values.std(ddof=1) / np.sqrt(8)
    assert size == pytest.approx((values.mean(), values.mean() - reach, values.mean() + reach), rel=1e-6)
    p = stats.ttest_1samp(values, 0.0).pvalue
    assert found.sigmas == pytest.approx(stats.norm.isf(p / 2), rel=1e-6)


def test_few_runs_show_nothing() -> None:
    table = disagreeing(along_mm_s=lambda _: 5.0)
    few = table[table["run"].isin(["r0", "r1", "r2"])]
    assert all(item.sigmas == 0.0 for item in every_dependence(few))
    four = table[table["run"].isin(["r0", "r1", "r2", "r3"])]
    assert any(item.sigmas > 0 for item in every_dependence(four) if item.by == "everywhere")


def test_size_of_a_disagreement_is_its_rms_with_bounds_over_runs() -> None:
    table = disagreeing()
    found = root_mean_squares(table)["along_mm_s"]
    squares = (table["along_mm_s"] ** 2).groupby(table["run"]).mean().to_numpy()
    reach = stats.t.isf(0.025, 15) * squares.std(ddof=1) / 4
    mean = squares.mean()
    ends = [np.sqrt(mean * np.exp(side * reach / mean)) for side in (-1, 1)]
    assert found == pytest.approx((np.sqrt(mean), *ends))
    agreeing = table.assign(along_mm_s=0.0)
    assert root_mean_squares(agreeing)["along_mm_s"] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("by", "fold", "crest", "at"),
    [
        ("heading", 1, 40.0, "40 degrees"),
        ("heading", 1, -70.0, "290 degrees"),
        ("twice the heading", 2, 40.0, "40 and 220 degrees"),
        ("twice the heading", 2, -30.0, "150 and 330 degrees"),
        ("three times the heading", 3, 40.0, "40 and 160 and 280 degrees"),
        ("four times the heading", 4, 40.0, "40 and 130 and 220 and 310 degrees"),
    ],
)
def test_a_wave_over_the_heading_is_found_with_all_its_crests(by: str, fold: int, crest: float, at: str) -> None:
    mean = disagreeing()["speed_rpm"].mean()
    table = disagreeing(
        along_mm_s=lambda row: 0.3 * row["speed_rpm"] / mean * np.cos(fold * np.radians(row["heading_deg"] - crest))
    )
    found = {(d.by, d.parity): d for d in every_dependence(table) if d.quantity == "along_mm_s"}[by, "even"]
    assert [size[0] for size in found.sizes] == pytest.approx(
        [0.3 * np.cos(np.radians(crest * fold)), 0.3 * np.sin(np.radians(crest * fold))], abs=0.003
    )
    assert f"0.3 mm/s more at {at}, whichever way it drives" in found.sentence


def test_what_stands_out_by_three_and_a_half_sigmas_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    items = [Dependence("along_mm_s", "everywhere", "even", sigmas, "") for sigmas in (3.4, 3.6, 9.0)]
    monkeypatch.setattr(disagreement, "every_dependence", lambda _: items)
    assert [item.sigmas for item in dependences(disagreeing())] == [9.0, 3.6]
    assert [item.sigmas for item in most_telling(disagreeing())] == [9.0, 3.6]
    less = [Dependence("along_mm_s", "everywhere", "even", sigmas, "") for sigmas in (1.2, 3.4, 0.0)]
    for left, told in ((less, [3.4]), (less[2:], [])):  # 0: too few runs to say
        monkeypatch.setattr(disagreement, "every_dependence", lambda _, left=left: left)
        assert [item.sigmas for item in most_telling(disagreeing())] == told


def test_a_run_of_less_than_a_second_is_one_piece_and_few_frames_are_none() -> None:
    for frames, count in ((5, 1), (4, 0)):
        time = 0.05 * np.arange(frames)
        marks = np.column_stack([time, 0 * time + 2, time, 0 * time - 2])
        run = RunData("r", 30.0, 30.0, 0.0, None, time, marks, 0)
        problem: Any = SimpleNamespace(
            data=[run],
            channels=[channels_of(marks)],
            residuals=lambda _, frames=frames: [np.zeros((frames, 4))],
            half_distance_mm=2.0,
        )
        assert len(pieces(problem, cast("Any", SimpleNamespace(task=lambda number: number)))) == count
