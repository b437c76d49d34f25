"""A simulated run that smaller steps would not confirm says so (10,000 random runs: benchmarks/converged.py)."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.integrator import convergence
from simulator.integrator.convergence import commands_beside, settled_mm, unsettled_mm
from simulator.robot import load_robot
from simulator.simulation import simulate, simulate_batch
from tests.simulator.random_runs import ALLOWED_MM, ALLOWED_SHARE, disagreement_mm, drawn

# Runs that were off by 0.05 to 5.6 mm at the default tolerance and did not say so, by seed and number.
ONCE_WRONG = [(2, 1682), (2, 4988), (2, 5516)]
CHECKED = [(2, 1682), (2, 4988), (3, 0), (3, 1), (2, 4092)]
AT_LENGTH = [
    pytest.param(*run, marks=pytest.mark.exam) for run in ((2, 2677), (1, 707))
]  # nor do these, in seconds each


@pytest.mark.parametrize(("seed", "number"), [*ONCE_WRONG, *AT_LENGTH, *((3, number) for number in range(20))])
def test_a_random_run_agrees_with_one_of_finer_steps_or_says_so(seed: int, number: int) -> None:
    off, way, says_so = disagreement_mm(drawn(np.random.default_rng([seed, number])))
    assert says_so or off <= ALLOWED_MM + ALLOWED_SHARE * way


@pytest.mark.parametrize("begin_s", [0.0, 0.1, 0.3, 0.5])
def test_compliant_column_robot_on_a_ramp_is_followed(begin_s: float) -> None:
    entries = [{"id": "axle-compliance", "deg_per_mN": 1.29}, {"id": "rolling-drag", "coefficient": 0.042}]
    robot = load_robot("column").model_copy(update={"effect": tuple(EffectEntry.model_validate(e) for e in entries)})
    ramp = Command([0.0, begin_s, begin_s + 0.11], [-37.6, -37.6, 126.5], [-23.5, -23.5, 0.0])
    times = np.linspace(0.0, 2.0, 121)
    usual, finer = simulate(robot, ramp, times), simulate(robot, ramp, times, tolerance_mm=1e-9)
    assert usual.is_converged
    assert np.hypot(usual.x_mm - finer.x_mm, usual.y_mm - finer.y_mm).max() < 2e-3


@pytest.mark.parametrize(("seed", "number"), [*CHECKED, *AT_LENGTH])
def test_a_checked_batch_says_of_a_run_what_simulate_says_of_it(seed: int, number: int) -> None:
    run = drawn(np.random.default_rng([seed, number]))
    alone = simulate(run.robot, run.command, run.times_s)
    among = simulate_batch([run.robot], [run.command], run.times_s, check=True)
    assert among.is_converged[0] == alone.is_converged
    np.testing.assert_allclose(among.unsettled_mm[0], alone.unsettled_mm, rtol=1e-6)
    np.testing.assert_allclose(among.states[0, :, 0], alone.x_mm, atol=1e-6)


@pytest.mark.parametrize(("seed", "number"), [(3, 1), (2, 4092)])
def test_a_checked_batch_says_how_far_a_run_is_off_as_simulate_does(
    seed: int, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With nothing allowed every run is off, by its step errors."""
    monkeypatch.setattr(convergence, "SETTLED_MM", 0.0)
    monkeypatch.setattr(convergence, "SETTLED_SHARE", 0.0)
    run = drawn(np.random.default_rng([seed, number]))
    alone = simulate(run.robot, run.command, run.times_s)
    among = simulate_batch([run.robot], [run.command], run.times_s, check=True)
    assert not alone.is_converged
    assert among.is_converged.tolist() == [False]
    assert among.unsettled_mm[0] == pytest.approx(alone.unsettled_mm, rel=1e-6)


def test_a_wheel_that_turns_over_within_a_ramp_is_followed_at_every_tolerance() -> None:
    """Where velocities could err by 2 %, it went one way or another, half a millimetre apart, as rounding decided."""
    run = drawn(np.random.default_rng([2, 4092]))
    found = simulate(run.robot, run.command, run.times_s)
    assert found.is_converged
    for tolerance in (1e-8, 1e-9, 1e-10):
        finer = simulate(run.robot, run.command, run.times_s, tolerance_mm=tolerance)
        assert np.hypot(found.x_mm - finer.x_mm, found.y_mm - finer.y_mm).max() < 1e-5


def test_a_batch_that_is_not_checked_says_nothing_of_convergence() -> None:
    command = Command.constant(33.3, 14.4)
    assert not simulate_batch([load_robot("barrel")], [command], [0.0, 0.5]).is_converged.any()
    checked = simulate_batch([load_robot("barrel")], [command] * 3, [0.0, 0.5], check=True)
    assert checked.is_converged.all()


def test_a_plain_turn_is_converged() -> None:
    assert simulate(load_robot("barrel"), Command.constant(33.3, 14.4), np.linspace(0, 5, 31)).unsettled_mm == 0.0


def test_two_solutions_agree_within_a_micrometre_and_half_a_thousandth_of_the_way() -> None:
    way = np.column_stack([np.linspace(0, 10, 50), np.zeros((50, 5))])
    for apart, found in ((0.0058, 0.0), (0.0062, 0.0062)):  # 0.001 + 5e-4 · 10 mm
        other = way.copy()
        other[20:30, 1] = apart
        assert unsettled_mm(other, way, 0.001) == pytest.approx(found)
    assert settled_mm({"time_unit": np.array([1.0, 3.0])}).tolist() == pytest.approx([0.001, 0.009])
    beside = commands_beside(np.array([[2.0, 50.0, -30.0]]))
    np.testing.assert_allclose(beside, [[[2.0, 50.005, -29.997]], [[2.0, 49.995, -30.003]]])
