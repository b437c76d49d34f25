"""The simulator of the diagnosis against the public one: every number of a task does what it says, with its sign."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.likelihood import simulation
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, RunData, Task, aligned_starts
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.likelihood.variants import depends_on_place, varied_robot
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.integrator.batch import integrate_many
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import moving_state, simulate

BARREL = load_robot("barrel")
TIME = np.arange(60) / 30
POSE = (3.0, -2.0, 0.7)
LEFT, RIGHT, START_S = 33.3, 14.4, 0.3
RUN = RunData("r3", LEFT, RIGHT, START_S, None, TIME, np.zeros((60, 4)), 3, {"camera, error 1": np.ones((60, 4))})
KNOWN = {
    "start_common_s": 0.5,
    "time_base": 0.05,
    "wheel_radius_difference": 2.0,
    "plate_level_x_deg": 100.0,
    "plate_level_y_deg": 50.0,
    "center_of_gravity_x_mm": 20.0,
    "center_of_gravity_y_mm": 10.0,
}
SIGMA_S = 0.02


def task(own: dict[int, float] | None = None, **values: Any) -> Task:
    numbers = [*POSE, 0.0, 0.0, 0.0, 0.0]
    for at, value in (own or {}).items():
        numbers[at] = value
    return Task(0, tuple(numbers), **values)


def found(one: Task, robot: Robot = BARREL) -> np.ndarray:
    terms = named_terms(20.0, (30.0, 60.0))
    (marks,) = Simulated([robot], [RUN], terms, KNOWN, SIGMA_S).marks([one])
    return marks


def expected(
    robot: Robot = BARREL,
    rpm: tuple[float, float] = (LEFT, RIGHT),
    start_s: float = START_S,
    pose: tuple[float, float, float] = POSE,
    time: np.ndarray = TIME,
) -> np.ndarray:
    run = simulate(robot, Command.constant(*rpm, start_s), time, State(*pose), run_index=3)
    return marks_of_run(robot, run).to_numpy()[:, 1:]


def with_effect(effect: str, **values: float) -> Robot:
    return BARREL.model_copy(update={"effect": (EffectEntry.model_validate({"id": effect, **values}),)})


def agree(one: np.ndarray, other: np.ndarray, unlike: np.ndarray | None = None) -> None:
    np.testing.assert_allclose(one, other, atol=2e-4)
    plain = expected() if unlike is None else unlike
    assert np.abs(other - plain).max() > 2e-3  # else nothing was asked


def test_a_task_without_deviations_is_the_run_as_the_files_say() -> None:
    np.testing.assert_allclose(found(task()), expected(), atol=2e-4)


def test_own_start_pose_is_that_of_the_robots_centre() -> None:
    pose = (4.0, -1.0, 1.1)
    agree(found(task({0: 4.0, 1: -1.0, 2: 1.1})), expected(pose=pose))


def test_own_friction_is_that_of_all_wheels_and_all_directions() -> None:
    slip = BARREL.slip
    names = ("longitudinal_friction", "lateral_friction")
    stronger = BARREL.model_copy(
        update={"slip": slip.model_copy(update={name: 1.3 * getattr(slip, name) for name in names})}
    )
    # Friction changes little of a steady turn, and only where the wheels slide far.
    agree(found(task({3: 0.3}), with_pull(BARREL)), expected(with_pull(stronger)), expected(with_pull(BARREL)))
    without = found(task({3: -1.0}))
    assert np.isnan(without).all()
    assert without.shape == (60, 4)


def with_pull(robot: Robot) -> Robot:
    pull = EffectEntry.model_validate({"id": "tether-pull", "x_mN": -4.0, "y_mN": 3.0})
    return robot.model_copy(update={"effect": (pull,)})


def test_own_gains_are_those_of_the_left_and_of_the_right_motor() -> None:
    agree(found(task({4: 0.05})), expected(rpm=(1.05 * LEFT, RIGHT)))
    agree(found(task({5: -0.05})), expected(rpm=(LEFT, 0.95 * RIGHT)))


def test_own_start_and_that_of_all_runs_are_later_by_their_sigmas() -> None:
    agree(found(task({6: 2.0})), expected(start_s=START_S + 2.0 * SIGMA_S))
    agree(found(task(nominal={"start_common_s": 0.2})), expected(start_s=START_S + 0.2 * 0.5))
    agree(found(task({6: 2.0}, nominal={"start_common_s": -0.2})), expected(start_s=START_S + 0.04 - 0.1))


def test_a_clock_that_runs_fast_is_that_of_frames_and_start() -> None:
    """Measured seconds are 1.01 of the true ones: a frame at 1 s was taken at 0.99 s, and the start too is measured."""
    agree(found(task(nominal={"time_base": 0.2})), expected(time=TIME / 1.01, start_s=START_S / 1.01))


def test_wheels_that_differ_are_off_by_half_of_it_each() -> None:
    agree(found(task(nominal={"wheel_radius_difference": 0.02})), expected(rpm=(1.02 * LEFT, 0.98 * RIGHT)))


@pytest.mark.parametrize(("x", "y"), [(0.03, 0.0), (0.0, 0.06), (-0.03, 0.04)])
def test_level_of_the_plate_is_a_tilt_toward_x_and_y(x: float, y: float) -> None:
    down = np.array([100.0 * x, 50.0 * y])
    tilt = {"angle_deg": float(np.hypot(*down)), "azimuth_deg": float(np.degrees(np.arctan2(down[1], down[0])))}
    agree(
        found(task(nominal={"plate_level_x_deg": x, "plate_level_y_deg": y})),
        expected(with_effect("plate-tilt", **tilt)),
    )


def test_centre_of_gravity_is_ahead_and_to_the_left() -> None:
    nominal = {"center_of_gravity_x_mm": 0.05, "center_of_gravity_y_mm": -0.08}
    moved = with_effect("mass-offset", x_mm=1.0, y_mm=-0.8)
    agree(found(task(nominal=nominal)), expected(moved))


def test_nominal_values_deviate_by_their_share() -> None:
    agree(
        found(task(nominal={"slip.lateral_stiffness": -0.3})),
        expected(varied_robot(BARREL, {"slip.lateral_stiffness": -0.3})),
    )


def test_shared_errors_move_the_marks_by_their_size_over_the_unit() -> None:
    moved = found(task(nominal={"camera, error 1": 3 * SHARED_UNIT}))
    np.testing.assert_allclose(moved - found(task()), 3.0, atol=1e-9)


@pytest.mark.parametrize(
    ("effect", "coordinates", "values"),
    [
        ("drive-speed-scale", (1.03,), {"factor": 1.03}),
        ("mark-offset", (0.2, -0.1, 3.0), {"x_mm": 0.2, "y_mm": -0.1, "angle_deg": 3.0}),
        ("speed-drift", (0.02,), {"per_run": 0.02}),
        ("time-base", (1.02,), {"factor": 1.02}),
    ],
)
def test_terms_are_the_effects_at_these_coordinates(
    effect: str, coordinates: tuple[float, ...], values: dict[str, float]
) -> None:
    robot = with_effect(effect, **values)
    factor = values["factor"] if effect == "time-base" else 1.0
    time, start_s = TIME / factor, START_S / factor
    agree(found(task(terms={effect: coordinates})), expected(robot, time=time, start_s=start_s))


def test_tasks_of_many_runs_keep_their_order() -> None:
    late = replace(RUN, left_rpm=20.0, time_s=TIME[:40], marks_mm=np.zeros((40, 4)), systematic={})
    simulated = Simulated([BARREL, BARREL], [RUN, late], {}, KNOWN, SIGMA_S)
    tasks = [replace(task(), run=1), task(), replace(task({4: 0.1}), run=1)]
    marks = simulated.marks(tasks)
    assert [len(item) for item in marks] == [40, 60, 40]
    np.testing.assert_allclose(marks[1], expected(), atol=2e-4)
    np.testing.assert_allclose(marks[0], expected(rpm=(20.0, RIGHT), time=TIME[:40]), atol=2e-4)
    np.testing.assert_allclose(marks[2], expected(rpm=(22.0, RIGHT), time=TIME[:40]), atol=2e-4)


def test_each_task_is_seen_as_its_own_terms_and_run_say() -> None:
    """Of three tasks the middle one has its marks elsewhere and a drift that counts its run: the others do not."""
    early = replace(RUN, order=0, systematic={})
    simulated = Simulated([BARREL] * 2, [RUN, early], named_terms(20.0, (30.0, 60.0)), KNOWN, SIGMA_S)
    moved = task(terms={"mark-offset": (0.2, -0.1, 3.0)})
    drifting = {"speed-drift": (0.02,)}
    plain, elsewhere, again = simulated.marks([task(), moved, task({4: 0.05})])
    np.testing.assert_allclose(plain, expected(), atol=2e-4)
    agree(elsewhere, expected(with_effect("mark-offset", x_mm=0.2, y_mm=-0.1, angle_deg=3.0)))
    agree(again, expected(rpm=(1.05 * LEFT, RIGHT)))
    fourth, first = simulated.marks([task(terms=drifting), replace(task(terms=drifting), run=1)])
    agree(fourth, expected(with_effect("speed-drift", per_run=0.02)))
    np.testing.assert_allclose(first, expected(), atol=2e-4)  # nothing has drifted yet


def test_tasks_with_and_without_ripple_keep_their_order() -> None:
    rippling = task(terms={"speed-ripple": (0.2, 0.0)})
    plain, rippled, later, again = Simulated([BARREL], [RUN], named_terms(20.0, (30.0, 60.0)), KNOWN, SIGMA_S).marks(
        [task(), rippling, task({4: 0.05}), replace(rippling, per_run=task({4: 0.05}).per_run)]
    )
    ripple = with_effect("speed-ripple", amplitude=0.2, phase_deg=0.0)
    np.testing.assert_allclose(plain, expected(), atol=2e-4)
    agree(rippled, expected(ripple))
    agree(later, expected(rpm=(1.05 * LEFT, RIGHT)))
    agree(again, expected(ripple, rpm=(1.05 * LEFT, RIGHT)), rippled)


@pytest.mark.parametrize("in_the_file", [False, True])
def test_wheels_that_ripple_may_need_steps_for_each_of_their_turns(
    monkeypatch: pytest.MonkeyPatch, *, in_the_file: bool
) -> None:
    """Wheels at 533 rpm turn 18 times in two seconds and need 1100 steps; without ripple a run needs some dozen."""
    monkeypatch.setattr(simulation, "MOST_STEPS", 200)
    fast = replace(RUN, left_rpm=533.0, right_rpm=320.0, systematic={})
    ripple = with_effect("speed-ripple", amplitude=0.28, phase_deg=0.0)
    robot, asked = (ripple, task()) if in_the_file else (BARREL, task(terms={"speed-ripple": (0.28, 0.0)}))
    terms = named_terms(20.0, (30.0, 60.0))
    (marks,) = Simulated([robot], [fast], terms, KNOWN, SIGMA_S).marks([asked])
    np.testing.assert_allclose(
        marks, expected(ripple, (533.0, 320.0)), atol=5e-3
    )  # a quarter of a per mille of the path
    monkeypatch.setattr(simulation, "STEPS_OF_A_TURN", 0)
    (failed,) = Simulated([robot], [fast], terms, KNOWN, SIGMA_S).marks([asked])
    assert np.isnan(failed).all()


def free_form(channel: str, basis: str, coefficient: float) -> EffectEntry:
    return EffectEntry.model_validate(
        {"id": "free-form", "channel": channel, "basis": basis, "coefficient": coefficient}
    )


@pytest.mark.parametrize(
    ("term", "parts"),
    [
        ("free:moment.one", [("moment", "one", 900.0)]),
        ("free:camera_x.time+camera_y.time", [("camera_x", "time", 0.3), ("camera_y", "time", -0.2)]),
        ("free:left_drive.right_command+right_drive.left_command", [("left_drive", "right_command", 0.1)]),
    ],
)
def test_terms_without_a_name_are_those_of_a_robot_file(term: str, parts: list[tuple[str, str, float]]) -> None:
    values = [part[2] for part in parts] + [0.0] * (2 - len(parts) if "+" in term else 0)
    robot = BARREL.model_copy(update={"effect": tuple(free_form(*part) for part in parts)})
    (marks,) = Simulated([BARREL], [RUN], free_terms()).marks([task(terms={term: tuple(values)})])
    agree(marks, expected(robot))


def test_without_a_sigma_of_the_start_no_run_has_a_start_of_its_own() -> None:
    (marks,) = Simulated([BARREL], [RUN], {}).marks([task({6: 50.0})])
    np.testing.assert_allclose(marks, expected(), atol=2e-4)


@pytest.mark.parametrize("factor", [1.0, 1.25])
def test_a_recording_that_begins_late_is_simulated_from_the_start_of_the_motors(factor: float) -> None:
    """By a clock that runs fast by a factor, which the start was read off as well."""
    late = replace(RUN, time_s=TIME + 1.0, systematic={})
    terms = named_terms(20.0, (30.0, 60.0))
    (marks,) = Simulated([BARREL], [late], terms).marks([task(terms={"time-base": (factor,)})])
    whole = expected(time=np.concatenate([[START_S], TIME + 1.0]) / factor, start_s=START_S / factor)
    np.testing.assert_allclose(marks, whole[1:], atol=2e-4)
    assert np.abs(whole[1] - whole[0]).max() > 0.3  # it has moved by its first frame


@pytest.mark.parametrize("first_s", [0.0, 1.0])
def test_a_log_has_the_true_clock_from_its_zero_on(first_s: float) -> None:
    """A camera that is 1.25 times as fast as stated does not delay the change, 0.4 s after the zero of the log."""
    steps = [(0.1, LEFT, RIGHT), (0.4, RIGHT, LEFT)]
    log = RunCommand(Command.steps([(START_S + at, *rpm) for at, *rpm in steps]), logged=True, zero_s=START_S)
    run = replace(RUN, log=log, start_s=START_S + 0.1, time_s=TIME + first_s, systematic={})
    terms = named_terms(20.0, (30.0, 60.0))
    (marks,) = Simulated([BARREL], [run], terms, KNOWN).marks(
        [task(terms={"time-base": (1.25,)}, nominal={"start_common_s": 0.1})]
    )
    zero_s = (START_S + 0.1 * KNOWN["start_common_s"]) / 1.25
    command = Command.steps([(zero_s + at, *rpm) for at, *rpm in steps])
    frames = np.concatenate([[min(zero_s + 0.1, first_s / 1.25) - 1e-3], run.time_s / 1.25])
    whole = marks_of_run(BARREL, simulate(BARREL, command, frames, State(*POSE), run_index=3)).to_numpy()[:, 1:]
    np.testing.assert_allclose(marks, whole[1:], atol=2e-4)


@pytest.mark.parametrize(
    ("friction", "run_in", "begin"),
    [
        (1e-3, None, State(*POSE)),  # it slides for a fifth of a second until it has gathered speed
        (1e-4, (1.0, 0.5, 0.4), State(*POSE, 1.0, 0.5 - 0.4 * -1.55, 0.4)),  # so long that it remembers; of the centre
    ],
    ids=["from rest", "as measured at the midpoint of the marks"],
)
def test_a_run_that_does_not_start_at_rest_has_the_velocity_of_its_command_at_its_first_frame(
    friction: float, run_in: tuple[float, float, float] | None, begin: State
) -> None:
    slip = BARREL.slip.model_copy(update={"longitudinal_friction": friction, "lateral_friction": 2 * friction})
    body, magnets = BARREL.body.model_copy(update={"mass_g": 50.0}), type(BARREL.magnetic_attraction)()
    slippery = BARREL.model_copy(update={"slip": slip, "body": body, "magnetic_attraction": magnets})
    command = Command.always(LEFT, RIGHT)
    log = RunCommand(command, starts_at_rest=False)
    moving = replace(RUN, log=log, start_s=0.0, systematic={}, run_in=run_in)
    other = replace(moving, run_in=None) if run_in else replace(moving, log=RunCommand(command))
    simulated = Simulated([slippery] * 2, [moving, other], {})
    of_moving, of_other = simulated.marks([task(), replace(task(), run=1)])
    start = moving_state(slippery, command, begin, -1e-3)
    run = simulate(slippery, command, np.concatenate([[-1e-3], TIME]), start, run_index=3)
    agree(of_moving, marks_of_run(slippery, run).to_numpy()[1:, 1:], of_other)


def test_starts_are_aligned_with_the_first_part_of_every_run() -> None:
    nominal = expected(pose=(0.0, 0.0, 0.0))
    points = nominal.reshape(-1, 2) @ np.array([[np.cos(0.8), np.sin(0.8)], [-np.sin(0.8), np.cos(0.8)]]) + [5.0, -4.0]
    marks = points.reshape(-1, 4).copy()
    marks[:2] = np.nan
    marks[12:] += 3.0  # later frames do not count
    data = [replace(RUN, marks_mm=marks, systematic={})]
    (own,) = aligned_starts(data, Simulated([BARREL], data, {}))
    np.testing.assert_allclose(own, [5.0, -4.0, 0.8, 0.0, 0.0, 0.0, 0.0], atol=1e-3)


def test_effects_that_depend_on_place_are_those_by_which_a_run_elsewhere_is_another() -> None:
    terms: dict[str, Any] = {**named_terms(20.0, (30.0, 60.0)), **free_terms()}
    simulated = Simulated([BARREL], [RUN], terms, KNOWN, SIGMA_S)
    mistaken = []
    for effect, term in terms.items():
        present = term.starts[-1] if term.starts else tuple(c.absent + c.step for c in term.coordinates)
        here, there = simulated.marks(
            [task(own, terms={effect: present}) for own in ({0: 3.0, 1: -2.0}, {0: 30.0, 1: 20.0})]
        )
        path = [marks - marks[0, [0, 1, 0, 1]] for marks in (here, there)]
        if (np.abs(path[1] - path[0]).max() > 1e-5) != depends_on_place(BARREL, [term]):
            mistaken.append(effect)
    assert not mistaken
    assert depends_on_place(BARREL.model_copy(update={"effect": (gradient(),)}), [])


def gradient() -> EffectEntry:
    return EffectEntry(id="friction-gradient", per_mm_x=1e-3, per_mm_y=0.0)


def test_runs_that_differ_in_their_start_pose_are_simulated_once_where_no_place_differs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts: list[int] = []

    def counted(*given: Any) -> Any:
        counts.append(len(given[5]))
        return integrate_many(*given)

    monkeypatch.setattr(simulation, "integrate_many", counted)
    there = [task({0: 40.0, 1: -3.0, 2: -2.1}), task({0: 40.0}), task({2: -2.1})]
    tilt, slope = {"plate-tilt": (2.0, 0.4)}, {"friction-gradient": (0.002, 0.001)}
    terms = named_terms(20.0, (30.0, 60.0))
    cases: list[tuple[dict[str, Any], int]] = [({}, 1), ({"terms": tilt}, 2), ({"terms": slope}, 3)]
    for values, wanted in cases:
        simulated = Simulated([BARREL], [RUN], terms, KNOWN, SIGMA_S)
        counts.clear()
        once = simulated.marks([replace(item, **values) for item in there])
        simulated.marks([replace(there[0], **values)])
        assert sum(counts) == wanted
        for item, marks in zip(there, once, strict=True):
            alone = Simulated([BARREL], [RUN], terms, KNOWN, SIGMA_S).marks([replace(item, **values)])[0]
            np.testing.assert_allclose(marks, alone, atol=1e-9)
    np.testing.assert_allclose(found(there[0]), expected(pose=(40.0, -3.0, -2.1)), atol=1e-4)
