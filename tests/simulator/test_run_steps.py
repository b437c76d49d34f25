"""Whole runs and long steps as plain Python, in a small stiff world whose motion another solver knows."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.simulator.plain import plain
from tests.simulator.test_integrator_steps import DRIVEN, MODEL, K, World, lives_in, worked

RUN, COLLOCATION = plain("run_kernel"), plain("collocation")
CONTROL, MANIFOLD = plain("step_control"), plain("slow_manifold")
POINTS, SHARES, U, X, HEADING = (getattr(COLLOCATION, name) for name in ("POINTS", "SHARES", "U", "X", "HEADING"))
STIFF = 100.0
STILL = SimpleNamespace(
    **vars(MODEL) | {"varies": 0, "wheels_vary": 0, "time_unit": 1.0, "wheels_vary_with_velocity": 0}
)
VARIED = SimpleNamespace(**vars(MODEL) | {"time_unit": 1.0, "wheels_vary_with_velocity": 0})


def world(monkeypatch: pytest.MonkeyPatch, law: World) -> None:
    """Let the forces of a law, of velocity, place and drive, be those of the robot; a command drives it."""
    lives_in(law, monkeypatch)
    rosenbrock = plain("rosenbrock")
    for name in ("accelerations", "slopes"):
        monkeypatch.setattr(COLLOCATION, name, getattr(rosenbrock, name))
    drive_at = plain("motors").drive_at
    for module in (rosenbrock, plain("implicit_euler"), MANIFOLD, COLLOCATION):
        monkeypatch.setattr(module, "drive_at", drive_at, raising=False)


def still(u: float, v: float, r: float, _place: Any, left: float) -> Any:
    """A steady motion in proportion to the left command, to which all others relax within a millisecond."""
    return STIFF * (left * DRIVEN - K @ [u, v, r])


def varied(u: float, v: float, r: float, place: Any, left: float) -> Any:
    """The same, with a pull that is fixed in the plate, a slope of the ground and a wind that grows."""
    x, y, cos, sin, time = place
    pull = np.array([3 * cos + 2 * sin, 2 * cos - 3 * sin, 0.5 * x - 0.3 * y])
    return STIFF * (left * DRIVEN + pull + np.array([0.4 * time, 0.1 * x, 0.0]) - K @ [u, v, r])


def solved(law: World, state: np.ndarray, times: np.ndarray, command: Any) -> np.ndarray:
    """States at times by another solver, from break to break of the command; command: left rpm at a time."""

    def rates(t: float, at: np.ndarray) -> list[float]:
        (x, y, heading), (u, v, r) = at[:3], at[3:]
        cos, sin = np.cos(heading), np.sin(heading)
        return [u * cos - v * sin, u * sin + v * cos, r, *law(u, v, r, (x, y, cos, sin, t), command(t))]

    return np.asarray(solve_ivp(rates, times[[0, -1]], state, "Radau", times, rtol=1e-7, atol=1e-9).y.T)


def filled() -> Any:
    """What a step works on, with room for that of a long one."""
    work = worked((0.0, 0.0, 0.0))
    work.segment, work.table, work.inverses = np.zeros(11), np.zeros((16, POINTS)), np.zeros((POINTS, 3, 3))
    work.growth = work.grown = 0.0
    return work


TIMES_S = np.array([0.0, 0.013, 0.11, 0.4, 0.7, 1.0, 1.002, 1.05, 1.3, 1.6])
BREAK_S = 1.0
START = np.array([1.0, -2.0, 0.4, 0.3, -0.1, 0.2])


def run(
    monkeypatch: pytest.MonkeyPatch, model: Any, law: World, *,
    most: int = 500, tolerance: float = 1e-8, unit: float = 1.0, knots: Any = None,
) -> tuple[np.ndarray, np.ndarray, tuple[int, int, float], np.ndarray]:  # fmt: skip
    """Outputs of a run at 2 rpm, from 1 s on at -1 rpm, its last state, what the kernel returns, and its steps.

    Steps (n, 3): when each begins, its length, and whether it is a long one.
    """
    world(monkeypatch, law)
    work = filled()
    contacts = np.zeros((40, 3))
    work.contacts = contacts
    told = np.array([[0.0, 2.0, 2.0], [BREAK_S, 2.0, 2.0], [BREAK_S, -1.0, -1.0]]) if knots is None else knots
    seen: dict[str, Any] = {}
    steps: list[tuple[float, float, bool]] = []
    write_step = RUN._write_step

    def noted(out: Any, times: Any, rows: Any, time: float, step: float, collocated: bool, work: Any) -> None:
        steps.append((time, step, collocated))
        write_step(out, times, rows, time, step, collocated, work)

    monkeypatch.setattr(RUN, "_write_step", noted)

    def command_segments(given: np.ndarray, begin: float, end: float, _model: Any) -> np.ndarray:
        seen["knots"], seen["span"] = np.array(given), (begin, end)
        pieces = [(begin, BREAK_S / unit, given[0, 1]), (BREAK_S / unit, end, given[-1, 1])]
        return np.array([[a, b, 1.0, rpm, 0, 0, 0, rpm, 0, 0, 0] for a, b, rpm in pieces])

    monkeypatch.setattr(RUN, "new_work", lambda _model: [work])
    monkeypatch.setattr(RUN, "command_segments", command_segments)
    out, state = np.full((len(TIMES_S), 6), np.nan), START.copy()
    model = SimpleNamespace(**vars(model) | {"time_unit": unit})
    result = RUN.integrate_run(model, told, state, TIMES_S, out, tolerance, most)
    assert seen["span"] == (TIMES_S[0] / unit, TIMES_S[-1] / unit)
    np.testing.assert_allclose(seen["knots"], told * [1 / unit, unit, unit])
    return out, state, result, np.array(steps)


def of_command(time: float) -> float:
    return 2.0 if time < BREAK_S else -1.0


@cache
def by_other_means(law: World) -> np.ndarray:
    before, after = TIMES_S[TIMES_S <= BREAK_S], TIMES_S[TIMES_S >= BREAK_S]
    first = solved(law, START, before, lambda _: 2.0)
    return np.vstack([first, solved(law, first[-1], after, lambda _: -1.0)[1:]])


@pytest.mark.parametrize(("model", "law"), [(STILL, still), (VARIED, varied)], ids=["still", "varied"])
def test_a_run_is_that_of_another_solver_in_long_steps_where_it_varies(
    model: Any, law: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, state, (done, used, grown), steps = run(monkeypatch, model, law)
    np.testing.assert_allclose(out, by_other_means(law), atol=2e-6)
    np.testing.assert_allclose(state, out[-1], atol=1e-12)
    assert (done, grown) == (RUN.DONE, 0.0)
    assert steps[:, 2].any() == (law is varied)
    for before, length in ((True, BREAK_S), (False, TIMES_S[-1] - BREAK_S)):
        mine = steps[(steps[:, 0] < BREAK_S) == before]
        assert mine[:, 1].sum() == pytest.approx(length) if law is varied else mine[:, 1].sum() < 0.6 * length
        if law is varied:
            assert mine[mine[:, 2] > 0, 1].sum() > 0.5 * length  # most of the way in long steps
    assert used == len(steps)
    _, _, (done, count, _), _ = run(monkeypatch, model, law, most=used - 1)
    assert (done, count) == (RUN.FAILED, used)  # one more step than allowed


def test_units_of_a_large_robot_leave_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lengths by the square of the unit of time, so that accelerations are alike: all forces by velocity over it."""
    unit = 4.0

    def scaled(u: float, v: float, r: float, _place: Any, left: float) -> Any:
        velocity = np.array([u * unit, v * unit, r / unit])  # mm/s, rad/s
        accelerated = STIFF * (left / unit * DRIVEN - K @ velocity)
        return accelerated * [1.0, 1.0, unit**2]

    out, state, (done, _, _), _ = run(monkeypatch, STILL, scaled, tolerance=1e-9, unit=unit)
    expected = by_other_means(still)
    assert done == RUN.DONE
    np.testing.assert_allclose(out, expected, atol=2e-6)
    np.testing.assert_allclose(state, expected[-1], atol=2e-6)


def test_outputs_are_those_before_the_end_of_a_segment_and_of_the_last_one_its_end_too() -> None:
    times = np.array([0.0, 0.5, 1.0, 1.5])
    assert RUN.output_rows(times, 1, 1.0, False) == 2
    assert RUN.output_rows(times, 1, 1.0, True) == 3
    assert RUN.output_rows(times, 3, 9.0, False) == 4
    assert RUN.output_rows(times, 2, 0.0, True) == 2


def on_manifold(law: World, left: float) -> np.ndarray:
    """The velocity at the start of a step, once relaxed: that of a run from a little before."""
    forces = law(0.0, 0.0, 0.0, (1.0, -2.0, np.cos(0.4), np.sin(0.4), 0.0), left)
    return np.linalg.solve(K, forces / STIFF)


def test_a_long_step_leads_where_the_relaxed_motion_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a hundredth of a micrometre a second off the manifold: that moves the robot by what is left over K."""
    world(monkeypatch, varied)
    work, model = filled(), VARIED
    work.segment[:] = [0.0, 9.0, 1.0, 2.0, 0, 0, 0, 2.0, 0, 0, 0]
    earlier = solved(
        varied, np.array([0.4, -2.2, -0.2, *on_manifold(varied, 2.0)]), np.array([-0.5, 0.0]), lambda _: 2.0
    )
    work.pose[:], work.y[3:] = earlier[-1, :3], earlier[-1, 3:] + [1e-5, -2e-5, 1e-5]
    plain("rosenbrock").linearize(0.0, True, model, work)
    assert MANIFOLD.near_manifold(1e-5, False, model, work)
    accurate, wanted = COLLOCATION.collocate(0.0, 0.3, 1e-5, model, work)
    assert accurate
    assert wanted >= 0.9 * 0.3
    times = np.concatenate([[0.0], 0.3 * SHARES[1:]])
    truth = solved(varied, np.array([*work.pose, *work.y[3:]]), times, lambda _: 2.0)
    found = work.table[[X, X + 1, HEADING, U, U + 1, U + 2]].T
    np.testing.assert_allclose(found[-1], truth[-1], atol=1e-6)
    np.testing.assert_allclose(found[5:, :3], truth[5:, :3], atol=1e-6)
    out, rows = np.full((4, 6), np.nan), np.array([0.2, 0.22, 0.25, 0.3])
    COLLOCATION.write_polynomials(out, rows, (0, 4), 0.0, 0.3, work.table)
    exact = solved(varied, truth[0], np.concatenate([[0.0], rows]), lambda _: 2.0)[1:]
    np.testing.assert_allclose(out, exact, atol=1e-6)


def test_a_sweep_solves_a_linear_world_at_once_and_tells_its_largest_change(monkeypatch: pytest.MonkeyPatch) -> None:
    world(monkeypatch, still)
    work = filled()
    work.segment[:] = [0.0, 9.0, 1.0, 2.0, 0, 0, 0, 2.0, 0, 0, 0]
    steady = np.linalg.solve(K, 2.0 * DRIVEN)
    for off, lever in (([0.3, 0.0, 0.0], 0.3), ([0.0, -0.2, 0.0], 0.2), ([0.0, 0.0, 0.15], 1.5)):
        work.table[U : U + 3] = (steady + off)[:, None]
        work.inverses[:] = np.linalg.inv(-STIFF * K)
        for renew in (False, True):
            change = COLLOCATION.sweep(0.0, 0.3, renew, STILL, work)
            np.testing.assert_allclose(work.table[U : U + 3].T, np.tile(steady, (POINTS, 1)), atol=1e-9)
            assert change == pytest.approx(0.0 if renew else lever, abs=1e-9)
    monkeypatch.setattr(COLLOCATION, "invert3", lambda *_: False)
    assert COLLOCATION.sweep(0.0, 0.3, True, STILL, work) == np.inf


def test_velocities_are_first_taken_in_proportion_to_the_command() -> None:
    """A drive from 3 / 4 rpm to twice that within the step."""
    work = filled()
    work.segment[:] = [1.0, 3.0, 0.0, 3.0, 1.5, 0, 0, 4.0, 2.0, 0, 0]
    work.y[3:], work.inverse[:] = [1.0, -2.0, 0.5], np.arange(9.0).reshape(3, 3)
    COLLOCATION._guess(1.0, 2.0, VARIED, work)
    np.testing.assert_allclose(work.table[U : U + 3], np.outer(work.y[3:], 1 + SHARES))
    np.testing.assert_allclose(work.inverses, (1 + SHARES)[:, None, None] * work.inverse)
    work.segment[3], work.segment[7] = 0.0, 0.0  # from rest: nothing to be in proportion to
    COLLOCATION._guess(1.0, 2.0, VARIED, work)
    np.testing.assert_allclose(work.table[U : U + 3], np.outer(work.y[3:], np.ones(POINTS)))


@pytest.mark.parametrize(
    ("longest", "short", "yaw", "possible", "tried", "taken"),
    [
        (9.0, 0.0, 0.0, 9.0, [1.0], 1.0),  # all that remains
        (0.3, 0.0, 0.0, 9.0, [0.25], 0.25),  # in equal shares
        (9.0, 0.0, 5.5, 9.0, [0.5], 0.5),  # half a turn or so
        (9.0, 0.0, -11.0, 9.0, [0.25], 0.25),
        (9.0, 0.0, 0.0, 0.1, [1.0, 0.25, 1 / 14], 1 / 14),  # three tenths of what failed, at most
        (9.0, 0.0, 0.0, 0.0, [1.0, 0.25, 1 / 14, 1 / 47, 1 / 157], 0.0),  # none shorter than 5 ms
        (9.0, 0.01, 0.0, 0.0, [1.0, 0.25, 1 / 14], 0.0),  # or than six short steps, as which it costs
        (0.1, 0.05, 0.0, 9.0, [0.25], 0.25),  # which may be longer than the last that failed
        (9.0, 0.2, 0.0, 9.0, [], 0.0),  # short steps reach the end sooner
    ],
)
def test_long_steps_share_what_remains(
    longest: float, short: float, yaw: float, possible: float, tried: list[float], taken: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    lengths: list[float] = []

    def collocate(_time: float, length: float, *_: object) -> tuple[bool, float]:
        lengths.append(length)
        return (True, 2 * length) if length <= possible else (False, 0.3 * length)

    monkeypatch.setattr(COLLOCATION, "collocate", collocate)
    work = filled()
    work.y[5] = yaw
    accurate, length, following = COLLOCATION.long_step(0.0, 1.0, longest, short, 1e-6, VARIED, work)
    assert lengths == pytest.approx(tried, rel=1e-3)
    last = lengths[-1] if lengths else 1.0  # what remains
    assert (accurate, length) == ((True, pytest.approx(taken, rel=1e-3)) if taken else (False, last))
    assert following == (2 * length if taken else length)


def test_first_steps_are_short_and_none_rests_on_an_unstable_balance(monkeypatch: pytest.MonkeyPatch) -> None:
    work = filled()
    work.segment[:] = [0.0, 9.0, 1.0, 2.0, 0, 0, 0, 2.0, 0, 0, 0]
    monkeypatch.setattr(RUN, "first_step", lambda *_: 0.7)
    assert RUN._asked_step(0.0, 0.0, 1e-6, VARIED, work) == pytest.approx(1e-3)  # the root of the tolerance
    assert RUN._asked_step(0.0, 0.0, 4.0, VARIED, work) == pytest.approx(0.7)
    assert RUN._asked_step(0.0, 0.4, 1e-6, VARIED, work) == 0.4
    monkeypatch.setattr(RUN, "growth_rate", lambda _: 50.0)
    assert RUN._asked_step(0.0, 0.4, 1e-6, VARIED, work) == pytest.approx(0.02)
    assert work.growth == 50.0
    work.segment[3], work.segment[7] = 0.0, 0.0
    assert RUN._asked_step(0.0, 0.4, 1e-6, VARIED, work) == 0.4  # motors off: as good as rest
    assert work.growth == 0.0
    finer = CONTROL.shrinking(1e-12)
    assert RUN._creeping_step(0.0, 1e-12) == pytest.approx(1e-5 * finer)
    assert RUN._creeping_step(1e5, 1e-12) == pytest.approx(300 * finer**2)


def test_a_run_that_takes_no_step_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RUN, "near_manifold", lambda *_: False)
    monkeypatch.setattr(RUN, "short_step", lambda *_: (0.0, 0.0))
    assert run(monkeypatch, STILL, still)[2][:2] == (RUN.FAILED, 1)
    monkeypatch.setattr(RUN, "short_step", lambda *_: (1e-12, 1e-12))  # forces that jump at this state
    monkeypatch.setattr(RUN, "is_resting", lambda *_: False)
    assert run(monkeypatch, STILL, still)[2][:2] == (RUN.FAILED, RUN.MOST_STALLED)


def test_a_run_whose_steps_need_thousands_of_evaluations_fails_long_before_it_has_taken_all_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Twenty-five evaluations for each step that it may take, 500 here: 40 steps of 314 evaluations, not 39."""

    def stuck(
        _time: float, _step: float, _remaining: float, _tol: float, _sticking: bool, _model: Any, work: Any
    ) -> Any:
        work.tried += 314.0
        return 1e-3, 1e-3

    monkeypatch.setattr(RUN, "near_manifold", lambda *_: False)
    monkeypatch.setattr(RUN, "short_step", stuck)
    for _ in range(2):  # each run begins to count anew
        assert run(monkeypatch, STILL, still)[2][:2] == (RUN.FAILED, 40)
