"""When a run counts as converged, what a batch shares, and where marks lie on a robot: nothing is integrated."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simulator import simulation
from simulator.command import Command
from simulator.errors import SimulationError
from simulator.integrator.convergence import CHECKS, MOST_CHECK_STEPS
from simulator.integrator.run_kernel import MOST_STEPS
from simulator.mark_layout import Mark, Marks, checked_layout, with_default_places
from simulator.run import Run, State, WheelStates
from simulator.simulation import Batch

RECORD = np.zeros(1, [("wheels", np.int64)])
COMMAND = Command.constant(10.0, 20.0)


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Solutions that are known: states all equal to a number by tolerance and by command; a distance is a difference.

    Set `states` by (share of the tolerance, number of the command: 0 as given, 1 and 2 beside it); None fails.
    """
    found = SimpleNamespace(states={}, asked=[], growth={})

    def followed(problem: Any, tolerance: float, steps: int) -> Any:
        key = (round(1e-7 / tolerance), int(problem[1][0, 0]))
        found.asked.append((*key, steps))
        value = found.states.get(key, 0.0)
        if value is None:
            raise SimulationError("no end")
        return np.full((2, 6), value), found.growth.get(key[0], 0.0)

    monkeypatch.setattr(simulation, "_followed", followed)
    monkeypatch.setattr(simulation, "settled_mm", lambda _: 0.5)
    monkeypatch.setattr(
        simulation, "unsettled_mm", lambda a, b, allowed: float(abs(a - b).max()) * (abs(a - b).max() > allowed)
    )
    monkeypatch.setattr(simulation, "commands_beside", lambda _: [np.full((1, 3), 1.0), np.full((1, 3), 2.0)])
    found.run = lambda: simulation.simulate(RECORD, COMMAND, [0.0, 1.0], tolerance_mm=1e-7)
    return found


FINE, FINEST = (round(value) for value in CHECKS)


@pytest.mark.parametrize(
    ("states", "shown", "unsettled"),
    [
        ({}, 0.0, 0.0),
        ({(FINE, 0): 0.4}, 0.0, 0.0),  # as near as solutions may be: the usual one is kept
        (
            {(1, 0): 3.0, (FINE, 0): 1.0, (FINEST, 0): 1.2, (1, 1): 1.0, (1, 2): 1.0},
            1.0,
            0.0,
        ),  # the next one confirms it
        ({(1, 0): 3.0, (FINE, 0): 1.0, (FINEST, 0): 2.0}, 2.0, 1.0),
        ({(FINE, 0): None}, 0.0, math.inf),
        ({(1, 1): 1.0, (1, 2): -1.0}, 0.0, 0.0),  # on either side: their mean counts
        ({(1, 1): 1.0, (1, 2): 1.0}, 0.0, 0.0),  # finer solutions of the same commands agree again
        ({(1, 1): 1.0, (1, 2): 1.0, (FINE, 1): 2.0, (FINE, 2): 1.0}, 0.0, 1.5),
        ({(1, 1): None}, 0.0, 0.0),
        ({(1, 1): None, (FINE, 2): None}, 0.0, math.inf),
    ],
)
def test_a_run_is_converged_if_smaller_steps_and_commands_beside_it_give_the_same(
    states: dict[tuple[int, int], float | None], shown: float, unsettled: float, solved: Any
) -> None:
    solved.states = states
    run = solved.run()
    assert (run.x_mm[0], run.unsettled_mm, run.is_converged) == (shown, pytest.approx(unsettled), unsettled == 0.0)
    assert solved.asked[0][2] == MOST_STEPS
    assert {steps for *_, steps in solved.asked[1:]} == {MOST_CHECK_STEPS}


def test_growth_of_disturbances_is_that_of_the_solution_that_is_shown_and_stays_a_number(solved: Any) -> None:
    solved.growth = {1: 2.0, FINE: 1e9}
    assert solved.run().amplification == pytest.approx(math.exp(2.0))
    solved.states = {(1, 0): 3.0}
    assert solved.run().amplification == math.exp(700.0)


def test_a_solution_has_the_steps_it_may_take(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "integrate_one", lambda *given: (1, given[-1], 0.0))
    with pytest.raises(SimulationError, match="did not finish within 77 steps"):
        simulation._followed((None, None, np.zeros(6), np.zeros(2)), 1e-7, 77)  # type: ignore[arg-type]


def test_a_moving_start_has_the_velocity_that_a_second_of_the_command_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    end = SimpleNamespace(u_mm_s=[0.0, 4.0], v_mm_s=[0.0, 5.0], yaw_rate_rad_s=[0.0, 6.0])
    monkeypatch.setattr(simulation, "simulate", lambda *given, **named: asked.append((given[2], named)) or end)
    pose = State(1.0, 2.0, 3.0, 9.0, 9.0, 9.0)
    assert simulation.moving_state(None, COMMAND, pose, 2.5, 7) == State(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)  # type: ignore[arg-type]
    assert asked == [([1.5, 2.5], {"start": pose, "run_index": 7})]  # with the velocity that was measured
    assert simulation._names(4) == simulation.WHEELS
    assert simulation._names(3) == ("wheel_1", "wheel_2", "wheel_3")


def test_curvature_of_a_batch_is_positive_for_a_centre_to_the_left_and_unknown_at_rest() -> None:
    states = np.zeros((4, 2, 6))
    states[:, 1, 3:] = [(3.0, 4.0, 1.0), (-3.0, 4.0, 1.0), (3.0, 4.0, -1.0), (0.0, 0.0, 0.0)]
    batch = Batch(np.array([0.0, 1.0]), states, np.array([0.0, 0.1, np.nan, 0.0]))
    np.testing.assert_allclose(batch.curvature_per_mm, [0.2, -0.2, -0.2, np.nan])
    assert batch.is_converged.tolist() == [True, False, False, True]


def test_entries_of_a_batch_are_one_for_all_or_one_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def integrate(
        models: Any,
        model: Any,
        knots: Any,
        first: Any,
        command: Any,
        starts: Any,
        times: Any,
        ends: Any,
        states: Any,
        *_: Any,
    ) -> None:
        asked.append(
            (
                len(models),
                model.tolist(),
                first.tolist(),
                command.tolist(),
                starts[:, 0].tolist(),
                times.tolist(),
                ends.tolist(),
            )
        )
        states[:] = len(knots)

    monkeypatch.setattr(simulation, "integrate_many", integrate)
    both = [COMMAND, Command.always(1.0, 2.0)]
    found = simulation.simulate_batch(RECORD, both, [0.0, 1.0, 2.0], [5.0, 0, 0, 0, 0, 0], summary=True)
    assert found.states.shape == (2, 2, 6)
    assert asked == [(1, [0, 0], [0, 2, 3], [0, 1], [5.0, 5.0], [0.0, 2.0, 0.0, 2.0], [0, 2, 4])]
    assert np.isnan(found.unsettled_mm).all()
    simulation.simulate_batch(np.zeros(2, RECORD.dtype), both[:1], [0.0, 1.0, 2.0])
    assert asked[1][1:4] == ([0, 1], [0, 2], [0, 0])
    assert asked[1][6] == [0, 3, 6]
    with pytest.raises(SimulationError, match="a batch of 3 runs needs 3 robots or a single one; found 2"):
        simulation.simulate_batch(np.zeros(2, RECORD.dtype), both[:1], [0.0, 1.0], np.zeros((3, 6)))


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 0.0], [0.0, np.nan], [[0.0, 1.0]]])
def test_times_of_a_run_are_two_and_increase(times: Any) -> None:
    with pytest.raises(SimulationError, match="at least two finite numbers that increase"):
        simulation._checked_times(times)


def test_corners_of_a_tag_lie_half_a_side_off_its_centre_from_the_rear_left_one_clockwise() -> None:
    tag = Mark(name="t", x_mm=1.0, y_mm=2.0, diameter_mm=3.0, kind="aruco")
    corners = {
        "t": (1, 2),
        "t_corner1": (-0.5, 3.5),
        "t_corner2": (2.5, 3.5),
        "t_corner3": (2.5, 0.5),
        "t_corner4": (-0.5, 0.5),
    }
    assert tag.points_mm() == corners
    assert list(Mark(name="t", x_mm=1.0, y_mm=2.0).points_mm()) == ["t"]


def test_marks_that_a_file_does_not_say_are_those_of_the_paper_in_proportion_to_the_body() -> None:
    paper = {"green_mm": [-1.55, 1.83], "yellow_mm": [-1.55, -1.83]}
    for body, ratio in (({"length_mm": 50.0}, 10.0), ({"length_m": 0.05}, 10.0), ({"length_mm": -1.0}, 1.0),
                        ({"length_mm": True}, 1.0), ({}, 1.0), (None, 1.0)):  # fmt: skip
        found = with_default_places({"body": body})["marks"]
        assert found == {name: pytest.approx([ratio * x, ratio * y]) for name, (x, y) in paper.items()}
    assert with_default_places({"marks": {"height_mm": 3.0}})["marks"]["height_mm"] == 3.0
    for said in ({"mark": [1]}, {"marks": {"a_mm": [1, 2]}}, {"marks": 3}, 7):
        assert with_default_places(said) is said


def test_a_robot_has_marks_of_one_kind_of_table_with_different_names() -> None:
    marks = Marks.model_validate({"a_mm": [1.0, 2.0], "b_mm": [3.0, 4.0], "height_m": 0.003})
    layout = checked_layout(marks, ())
    assert [(one.name, one.place_mm, one.diameter_mm, one.height_mm) for one in layout] == [
        ("a", (1.0, 2.0), 1.0, 3.0), ("b", (3.0, 4.0), 1.0, 3.0),
    ]  # fmt: skip
    with pytest.raises(ValueError, match="there are both"):
        checked_layout(marks, layout)
    with pytest.raises(ValueError, match="mark name a is used more than once"):
        checked_layout(Marks(), (*layout, layout[0]))


def test_table_of_a_run_has_angles_in_degrees_and_every_number_in_the_column_that_names_it() -> None:
    wheels = WheelStates(*np.array([[[0.1, 0.2]], [[0.3, 0.4]], [[5.0, 6.0]], [[7.0, 8.0]]]))
    time, x, y, heading, u, v, yaw = np.array([[0.5], [1.0], [2.0], [0.03], [4.0], [5.0], [0.6]])
    run = Run(time, x, y, heading, u, v, yaw, lambda: wheels, wheel_names=("l", "r"))
    degrees = 180 / math.pi
    assert run.to_table().iloc[0].to_dict() == pytest.approx(
        {
            "time_s": 0.5,
            "x_mm": 1.0,
            "y_mm": 2.0,
            "heading_deg": 0.03 * degrees,
            "u_mm_s": 4.0,
            "v_mm_s": 5.0,
            "yaw_rate_deg_s": 0.6 * degrees,
            "l_slip_ratio": 0.1,
            "l_slip_angle_deg": 0.3 * degrees,
            "l_longitudinal_force_mN": 5.0,
            "l_lateral_force_mN": 7.0,
            "r_slip_ratio": 0.2,
            "r_slip_angle_deg": 0.4 * degrees,
            "r_longitudinal_force_mN": 6.0,
            "r_lateral_force_mN": 8.0,
        }
    )
