"""Mistakes of an experiment are named for what they are, before any physics; large effects are not taken for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.belief import beyond_the_others
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.diagnosis.mistakes.recognised import Found, Kind
from tests.evaluator.diagnosis.hidden import hidden_session
from tests.evaluator.diagnosis.marks_of_motion import onset_s

Change = Callable[[RunData], RunData]
TURN = 4  # number of the run that is changed: a turn driven backward


def _later(run: RunData, after_s: float, shift: tuple[float, float]) -> RunData:
    return replace(run, marks_mm=run.marks_mm + (run.time_s > after_s)[:, None] * np.tile(shift, 2))


def _standing(run: RunData) -> RunData:
    noise = np.random.default_rng(5).normal(size=run.marks_mm.shape) * 0.003
    return replace(run, marks_mm=np.nanmedian(run.marks_mm[:5], axis=0) + noise)


def _pushed(run: RunData) -> RunData:
    """Moved by 3 mm within half a second."""
    share = np.clip((run.time_s - 2.0) / 0.5, 0.0, 1.0)
    return replace(run, marks_mm=run.marks_mm + share[:, None] * np.tile((2.5, -1.5), 2))


def _every_other_frame(run: RunData) -> RunData:
    """Half of the frames, as far apart as before: twice as fast, and the start is at half of its time."""
    return replace(run, time_s=run.time_s[::2] / 2, marks_mm=run.marks_mm[::2])


CHANGES: dict[str, tuple[str, Change]] = {
    "signs": ("reversed", lambda r: replace(r, left_rpm=-r.left_rpm, right_rpm=-r.right_rpm)),
    "sides": ("sides-swapped", lambda r: replace(r, left_rpm=r.right_rpm, right_rpm=r.left_rpm)),
    "columns": ("marks-swapped", lambda r: replace(r, marks_mm=r.marks_mm[:, [2, 3, 0, 1]])),
    "mirror": ("mirrored", lambda r: replace(r, marks_mm=r.marks_mm * [-1.0, 1.0, -1.0, 1.0])),
    "half the rate": ("wrong-rate", lambda r: replace(r, time_s=2 * r.time_s)),
    "at 60/s as the others, filmed at 30/s": ("wrong-rate", _every_other_frame),
    "metres": ("wrong-unit", lambda r: replace(r, marks_mm=r.marks_mm / 1000)),
    "inches": ("wrong-unit", lambda r: replace(r, marks_mm=r.marks_mm / 25.4)),
    "another robot": ("wrong-robot", lambda r: replace(r, marks_mm=1.3 * r.marks_mm)),
    "another run's command": ("wrong-command", lambda r: replace(r, left_rpm=60.0, right_rpm=40.0)),
    "late": ("late-start", lambda r: replace(r, start_s=r.start_s - 0.2)),
    "after the end": ("late-start", lambda r: replace(r, start_s=500.0)),
    "held": ("stuck", _standing),
    "pushed": ("pushed", _pushed),
    "knocked": ("camera-moved", lambda r: _later(r, 2.0, (0.8, 0.3))),
}


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return hidden_session(tmp_path_factory.mktemp("clean"), {})


@pytest.mark.parametrize("change", sorted(CHANGES))
def test_a_mistake_in_one_run_is_named_with_its_run_and_kind(clean: Session, change: str) -> None:
    kind, act = CHANGES[change]
    data = [act(run) if number == TURN else run for number, run in enumerate(clean.data)]
    assert [(item.runs, item.kind) for item in recognise(data, clean.robots)] == [((f"r{TURN}",), kind)]


def test_a_mistake_in_all_runs_is_said_once(clean: Session) -> None:
    swapped = [replace(run, left_rpm=run.right_rpm, right_rpm=run.left_rpm) for run in clean.data]
    metres = [replace(run, marks_mm=run.marks_mm / 1000) for run in clean.data]
    (unit,) = recognise(metres, clean.robots)
    assert unit.everywhere
    assert unit.sentence.startswith("all runs, ")
    turns = {item.kind for item in recognise(swapped, clean.robots)}
    assert turns == {"sides-swapped"}


def test_commands_of_all_runs_in_another_unit_are_corrected_to_rpm(clean: Session) -> None:
    for factor in (2 * np.pi / 60, 2.0):
        wrong = [replace(r, left_rpm=factor * r.left_rpm, right_rpm=factor * r.right_rpm) for r in clean.data]
        (said,) = recognise(wrong, clean.robots)
        assert (said.kind, said.everywhere) == ("wrong-unit", True)
        corrected = {run: item.command for run, item in said.corrections.items()}
        assert corrected == {run.id: pytest.approx(run.command) for run in clean.data}
    geared = [replace(r, left_rpm=298 * r.left_rpm, right_rpm=298 * r.right_rpm) for r in clean.data]
    (said,) = recognise(geared, clean.robots)
    assert (said.kind, said.everywhere, said.corrections) == ("wrong-unit", True, {})  # no gear is exactly known
    times = float(said.sentence.split("turned ")[1].split(" times")[0])
    assert 298 * times == pytest.approx(1.0, rel=0.02)


def test_times_of_all_runs_that_count_twice_are_a_wrong_rate(clean: Session) -> None:
    (said,) = recognise([replace(run, time_s=2 * run.time_s) for run in clean.data], clean.robots)
    assert (said.kind, said.everywhere) == ("wrong-rate", True)


LARGE = {
    "drive-speed-mismatch": {"left_over_right": 1.08},
    "friction-level": {"factor": 0.4},
    "command-lag": {"dead_time_s": 0.2, "time_constant_s": 0.2},
    "speed-ripple": {"amplitude": 0.2, "phase_deg": 30.0},
    "dead-band": {"rpm": 35.0},
    "mass-offset": {"x_mm": 1.5, "y_mm": 1.0},
    "wheel-toe": {"left_deg": 6.0, "right_deg": -3.0},
    "stray-magnet": {"force_mN": 2.0, "x_mm": 40.0, "y_mm": 25.0, "exponent": 1.0},
    "plane-scale": {"factor": 1.04},
    "camera-tilt": {"per_mm_x": -3e-3, "per_mm_y": 4e-3, "perspective": 1.0},
}


@pytest.mark.parametrize("effect", sorted(LARGE))
def test_a_large_effect_is_no_mistake(effect: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    assert hidden_session(tmp_path_factory.mktemp("large"), {effect: LARGE[effect]}).mistakes == ()


def test_another_robot_is_named_among_runs_seen_by_a_tilted_camera(tmp_path_factory: pytest.TempPathFactory) -> None:
    tilted = hidden_session(tmp_path_factory.mktemp("tilted"), {"camera-tilt": LARGE["camera-tilt"]})
    data = [replace(run, marks_mm=1.3 * run.marks_mm) if k == TURN else run for k, run in enumerate(tilted.data)]
    assert [(item.runs, item.kind) for item in recognise(data, tilted.robots)] == [((f"r{TURN}",), "wrong-robot")]


def test_the_onset_of_motion_is_told_to_a_few_milliseconds_and_not_of_a_run_that_moves_already(clean: Session) -> None:
    found = [onset for run in clean.data if (onset := onset_s(run)) is not None]
    assert len(found) >= len(clean.data) - 1
    assert np.median(np.abs(np.array(found) - 0.3)) < 0.01
    moving = [replace(r, time_s=r.time_s[r.time_s > 1.0], marks_mm=r.marks_mm[r.time_s > 1.0]) for r in clean.data]
    assert [onset_s(run) for run in moving] == [None] * len(moving)


@pytest.mark.parametrize(
    ("others", "believed"),
    [
        ((0.02, 0.03, 0.05), True),  # a recording of another command, 0.3 of its path off, among runs that are right
        ((0.02, 0.05, 0.17), False),  # an effect bends others by more than half as much
        ((0.02,), True),  # one other run tells nothing of what is usual
        ((0.02, float("nan"), 0.17), True),
    ],
)
def test_a_wrong_command_or_a_turn_the_other_way_misses_by_more_than_effects_make_runs_read_rightly(
    others: tuple[float, ...], believed: bool
) -> None:
    def judgement(run: str, share: float) -> Any:
        stated = SimpleNamespace(id=run, command=(10.0, 20.0), log=None)
        ways = [SimpleNamespace(run=stated, kind=kind) for kind in (None, *kinds)]
        misfits_mm = [share / 0.32 * 3.0, 0.1, turned, turned]
        return SimpleNamespace(ways=ways, extent_mm=3.0 / 0.32, misfits_mm=misfits_mm, turn_rad=(np.nan, np.nan))

    turned = 0.31
    kinds: tuple[Kind, ...] = ("wrong-command", "sides-swapped", "mirrored")
    seen = [judgement("r0", 0.32), *(judgement(f"r{k + 1}", share) for k, share in enumerate(others))]
    for wrong in (Found("r0", kind, "", "") for kind in kinds):
        assert beyond_the_others([wrong], seen) == [wrong] * believed
    reversed_ = Found("r0", "reversed", "", "")
    assert beyond_the_others([reversed_], seen) == [reversed_]
    turned = 0.29  # an effect turns no run to the other side so that it fits ten times better
    seen = [judgement("r0", 0.32), *seen[1:]]
    for kind in kinds[1:]:
        assert len(beyond_the_others([Found("r0", kind, "", "")], seen)) == 1
    assert len(beyond_the_others([Found("r0", "wrong-command", "", "")], seen)) == believed
