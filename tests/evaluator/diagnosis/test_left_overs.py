"""Left-overs against their textbook tests; gap, relevance and knowledge in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import make_dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis.assessment import relevance
from evaluator.diagnosis.assessment.adequacy import _known, _order, adequacy
from evaluator.diagnosis.assessment.gap import farthest_followed, noise_floor, rms, run_gaps
from evaluator.diagnosis.assessment.knowledge import Knowledge, knowledge
from evaluator.diagnosis.inference.fitted_model import left_overs
from evaluator.diagnosis.likelihood.features import MODEL_FLOOR_MM
from evaluator.diagnosis.likelihood.known_to import Quantity
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.settings import Relevant
from tests.evaluator.diagnosis.synthetic import (
    column,
    fit_of,
    linear_runs,
    run_data,
)

TAU = np.array([0.05, 0.02, 0.02, 1.0])
COLUMNS = [column("slip.lateral_friction", effect=False), column("effect")]

EVERY = np.zeros(4)  # no dependence is too small to count


def test_excess_is_the_mean_square_of_what_no_effect_and_no_number_of_a_run_takes() -> None:
    runs = linear_runs(count=6)
    wide = [
        type(run)(
            *(
                np.concatenate([part, np.random.default_rng(n).normal(size=(6, *part.shape[1:]))])
                for part in (run.response, run.common, run.start, run.scatter)
            )
        )
        for n, run in enumerate(runs)
    ]
    fit = fit_of(wide, COLUMNS, np.array([0.2, 0.1]), TAU)
    data = [run_data(30.0, 20.0, number) for number in range(6)]
    squares = []
    for run in wide:
        columns = np.column_stack([run.start, run.scatter, run.common[:, 1:]])  # the first is known to a tolerance
        away = run.response - run.common @ [0.2, 0.1]
        away = away - columns @ np.linalg.lstsq(columns, away)[0]
        squares.append(away @ away)
    found = adequacy(fit, data)
    assert found.excess == pytest.approx(sum(squares) / (6 * 7))
    np.testing.assert_allclose(found.by_run, np.array(squares) / 7)
    assert found.excess_sigma == pytest.approx((found.excess - 1) / np.sqrt(2 / 42))


@pytest.mark.parametrize(("gain", "told"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_run_determines_as_much_of_an_effect_as_it_knows_beside_the_scatter(gain: float, told: bool) -> None:
    """A feature a·b + ε of scatter τ determines a²τ²/(1 + a²τ²) of its variance; b is shrunk by as much."""
    slopes, rng = np.array([30.0, 200.0, 400.0, 2.0]), np.random.default_rng(4)
    true = TAU * rng.normal(size=(12, 4)) * [1.0, 1.0, 1e-3, 1.0]
    true[:, 2] += gain * np.linspace(-1.0, 1.0, 12)  # the right wheel, from the first run to the last
    unit, response = np.eye(9), np.zeros((12, 9))
    response[:, 3:7] = slopes * true
    views = [Linearized(row, np.zeros((9, 2)), unit[:, :3], unit[:, 3:7] * slopes) for row in response]
    data = [run_data(30.0, 20.0, number) for number in range(12)]
    found = adequacy(fit_of(views, COLUMNS, np.zeros(2), TAU), data, relevant_gain=1e-3)
    share = (slopes * TAU) ** 2 / (1 + (slopes * TAU) ** 2)
    np.testing.assert_allclose(found.shares, np.tile(share, (12, 1)))
    np.testing.assert_allclose(found.random_effects, share * true)
    assert (found.order_p < 1e-6) == told
    assert (found.depends_on == "right gain of the runs depends on order") == told


def test_friction_and_start_that_follow_the_heading_are_told_whatever_gain_of_the_wheels_matters() -> None:
    rng, angle = np.random.default_rng(7), np.linspace(0.0, 5.0, 12)
    places = 10.0 * rng.normal(size=(12, 2))
    data = [
        replace(run_data(30.0, 20.0, number), marks_mm=np.tile([x + 3 * np.cos(a), y + 3 * np.sin(a), x, y], (4, 1)))
        for number, (a, (x, y)) in enumerate(zip(angle, places, strict=True))
    ]
    unit, slopes = np.eye(9), 100.0 / TAU
    for which, what in ((0, "friction"), (3, "start")):
        effects = 1e-3 * TAU * rng.normal(size=(12, 4))
        effects[:, which] += TAU[which] * np.cos(angle)
        response = np.zeros((12, 9))
        response[:, 3:7] = slopes * effects
        views = [Linearized(row, np.zeros((9, 2)), unit[:, :3], unit[:, 3:7] * slopes) for row in response]
        found = adequacy(fit_of(views, COLUMNS, np.zeros(2), TAU), data, relevant_gain=0.5)
        assert found.depends_on == f"{what} of the runs depends on heading"
        assert found.order_p < 1e-6


def test_a_value_known_to_a_tolerance_does_not_take_up_the_noise_that_its_column_holds() -> None:
    """A mark moved along the robot: its column is the start pose, and a trace of the noise of the heading."""
    rng = np.random.default_rng(2)
    views = []
    for _ in range(40):
        noise, start, scatter = rng.normal(size=60), rng.normal(size=(60, 3)), rng.normal(size=(60, 4))
        views.append(Linearized(noise, (start[:, 0] + 1e-4 * noise)[:, None], start, scatter))
    squares, freedom = left_overs(views, COLUMNS[:1], np.zeros(1))
    assert squares.sum() / freedom.sum() == pytest.approx(1.0, abs=0.1)


def test_a_wheel_speed_that_follows_the_order_has_the_p_value_of_the_textbook_times_what_was_asked() -> None:
    rng = np.random.default_rng(1)
    data = [
        run_data(30.0 + rng.normal(), 20.0 + rng.normal(), number, tuple(rng.normal(size=2))) for number in range(12)
    ]
    own = rng.normal(size=(12, 4))
    own[:, 1] += 0.5 * np.arange(12)
    p, reason = _order(own, np.ones((12, 4)), data, EVERY)
    single = stats.linregress(np.arange(12), own[:, 1]).pvalue
    assert reason == "left gain of the runs depends on order"
    # Nine things are known of a run, direction and side are the same in all, and so is the heading: four are asked.
    asked = [
        columns
        for columns in _known(data).values()
        if np.linalg.matrix_rank(np.column_stack([np.ones(12), columns])) > columns.shape[1]
    ]
    assert p == pytest.approx(single * (4 * len(asked) - 2), rel=1e-6)  # friction and start may follow the order


@pytest.mark.parametrize(("gain", "told"), [(0.9e-3, False), (1.1e-3, True)])
def test_gains_that_depend_on_something_by_less_than_matters_do_not_count(gain: float, told: bool) -> None:
    rng = np.random.default_rng(3)
    data = [run_data(30.0, 20.0, number) for number in range(12)]
    scatter, own = 1e-3, 1e-2 * rng.normal(size=(12, 4))
    own[:, 2] += gain / scatter * np.linspace(-1.0, 1.0, 12)  # from the first run to the last
    p, reason = _order(own, np.ones((12, 4)), data, np.array([0.0, 1e-3, 1e-3, 0.0]) / scatter)
    assert (p < 1e-6) == told
    assert (reason == "right gain of the runs depends on order") == told


def test_runs_that_tell_little_of_their_speed_count_little() -> None:
    rng = np.random.default_rng(2)
    data = [run_data(30.0, 20.0, number) for number in range(12)]
    own, told = rng.normal(size=(12, 4)), np.ones((12, 4))
    own[:, 1] = 0.5 * np.arange(12) + 0.1 * rng.normal(size=12)
    own[6, 1], told[6, 1] = 1e3, 0.009
    assert _order(own, told, data, EVERY)[0] < 1e-6
    told[:, 1] = 0.009
    assert "left gain" not in _order(own, told, data, EVERY)[1]
    assert _order(own[:7], told[:7], data[:7], EVERY)[0] == 1.0  # five degrees of freedom say little
    shrunk = np.array(own)
    share = np.linspace(0.2, 0.9, 12)
    told = np.ones((12, 4))
    told[:, 1] = share
    shrunk[:, 1] = share * 0.5 * np.arange(12) + np.sqrt(share) * 0.1 * rng.normal(size=12)
    weight = np.sqrt(share)
    design = np.column_stack([np.ones(12), np.arange(12)]) * weight[:, None]
    values = shrunk[:, 1] / weight
    alone = [values @ values - values @ part @ np.linalg.lstsq(part, values)[0] for part in (design[:, :1], design)]
    p = stats.f.sf((alone[0] - alone[1]) / (alone[1] / 10), 1, 10)
    assert _order(shrunk, told, data, EVERY)[0] == pytest.approx(
        2 * p, rel=1e-5
    )  # order alone differs between these runs, and two are asked of it


def test_what_is_known_of_a_run_is_its_command_heading_place_and_order() -> None:
    known = _known([run_data(-30.0, -10.0, 4, (3.0, 7.0))])
    assert {name: value.ravel().tolist() for name, value in known.items() if "heading" not in name} == {
        "direction": [-1.0],
        "side": [1.0],
        "direction and side together": [-1.0],
        "speed": [40.0],
        "the difference of the wheels": [20.0],
        "place": [3.0, 7.0],
        "order": [4.0],
    }
    np.testing.assert_allclose(known["heading"], [[1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(known["twice the heading"], [[1.0, 0.0]], atol=1e-12)
    facing_up = replace(run_data(30.0, 10.0), marks_mm=np.array([[-2.0, 0.0, 2.0, 0.0]]))
    np.testing.assert_allclose(np.abs(_known([facing_up])["heading"]), [[0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(_known([facing_up])["twice the heading"], [[-1.0, 0.0]], atol=1e-12)


def test_gap_of_a_run_is_the_rms_distance_of_its_midpoint() -> None:
    residual = np.array([[3.0, 4.0, 9.0, 9.0], [0.0, 1.0, 9.0, 9.0], [np.nan] * 4])
    problem: Any = SimpleNamespace(residuals=lambda _: [residual])
    placed: Any = SimpleNamespace(task=lambda run: run)
    assert run_gaps(problem, placed, [0]) == pytest.approx([np.sqrt((25 + 1) / 2)])


def test_floor_is_the_noise_of_both_coordinates_and_the_precision_of_the_model() -> None:
    noise = (Noise(0.003, 0.0, 0.1), Noise(0.004, 0.0, 0.1), Noise(9.0, 0.0, 0.1), Noise(9.0, 0.0, 0.1))
    data = [SimpleNamespace(time_s=np.linspace(0, 4, 240))]
    for random_mm in (0.0, 0.012):
        ground = [SimpleNamespace(random_mm=random_mm)]
        problem: Any = SimpleNamespace(noise=[noise], length=1.0, data=data, open_ground=False, compressions=ground)
        assert noise_floor(problem, [0]) == pytest.approx([np.sqrt(0.005**2 + random_mm**2 + MODEL_FLOOR_MM**2)])
        tracking_mm = np.hypot(0.005, MODEL_FLOOR_MM)
        farthest = np.hypot(2.5 * tracking_mm, 4.0 * random_mm)
        assert farthest_followed(problem, [0]) == pytest.approx([farthest])


def test_floor_holds_what_a_start_pose_leaves_of_a_drift_but_on_ground_all_that_is_called_drift() -> None:
    drifting = Noise(0.003, 0.0, 0.1, common_drift=Drift(0.020, 16.0))
    data = [SimpleNamespace(time_s=np.linspace(0, 4, 240))]
    for ground, per_coordinate in ((False, drifting.about_mean_mm(4.0)), (True, drifting.sigma_mm)):
        problem: Any = SimpleNamespace(
            noise=[(drifting, drifting)],
            length=1.0,
            data=data,
            open_ground=ground,
            compressions=[SimpleNamespace(random_mm=0.0)],
        )
        assert noise_floor(problem, [0])[0] == pytest.approx(np.sqrt(2) * per_coordinate, rel=1e-3)
    assert drifting.about_mean_mm(4.0) < 0.6 * drifting.sigma_mm


def test_rms_over_runs_leaves_out_what_is_not_known() -> None:
    values = np.array([3.0, np.nan, 4.0, 100.0])
    assert rms(values, [0, 1, 2]) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(values, []))
    assert np.isnan(rms(values, [1]))


def circling(radius: float, speed: float) -> np.ndarray:
    """Marks of a robot on a circle for 3 s; the circle of the midpoint of its marks."""
    angle = speed / radius * np.arange(0, 3, 0.02)
    middle = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    side = 2 * np.column_stack([-np.sin(angle), np.cos(angle)])
    return np.concatenate([middle + side, middle - side], axis=1)


def changed(present: np.ndarray, absent: np.ndarray, floor_mm: float = 0.005, **run: Any) -> relevance.Changes:
    """What an effect changes that makes these marks of those."""
    return changed_in([(present, absent)], floor_mm, **run)


def changed_in(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], floor_mm: float = 0.005, **run: Any
) -> relevance.Changes:
    """What an effect changes in runs whose marks it makes of others."""
    data = [RunData("r", 30.0, 20.0, 0.0, None, np.arange(0, 3, 0.02), absent, 0) for _, absent in pairs]
    noise = (Noise(floor_mm, 0.0, 0.1), Noise(0.0, 0.0, 0.1))
    problem: Any = SimpleNamespace(
        open_ground=False,
        length=1.0,
        data=[replace(item, **run) for item in data],
        noise=[noise] * len(pairs),
        compressions=[SimpleNamespace(random_mm=0.0)] * len(pairs),
        forward=SimpleNamespace(marks=lambda tasks: [pairs[number][0 if acts else 1] for number, acts in tasks]),
    )
    point = make_dataclass("P", ["terms"], namespace={"task": lambda self, run: (run, bool(self.terms))})
    fit: Any = SimpleNamespace(runs=tuple(range(len(pairs))), point=point({"effect": (1.0,)}))
    return relevance.changes(problem, fit, "effect")


def test_changes_are_the_largest_in_any_run() -> None:
    plain, faster = circling(5.0, 2.0), circling(5.0, 2.2)
    runs = [(plain, plain), (faster, plain), (plain, plain)]
    assert changed_in(runs) == changed(faster, plain)


def test_changes_of_path_radius_and_speed_are_those_of_the_circles() -> None:
    found = changed(circling(5.5, 2.2), circling(5.0, 2.0))
    assert found.speed_percent == pytest.approx(10.0, rel=1e-3)
    assert found.radius_percent == pytest.approx(10.0, rel=1e-3)
    middles = [np.exp(0.4j * np.arange(0, 3, 0.02)) * radius for radius in (5.5, 5.0)]
    apart = 0.1 * np.sqrt(np.mean(np.abs(middles[1] - middles[1].mean()) ** 2))
    assert found.path_noise_floors == pytest.approx(apart / np.hypot(0.005, MODEL_FLOOR_MM), rel=1e-3)
    wider = changed(circling(5.5, 2.0), circling(5.0, 2.0))
    assert (wider.speed_percent, wider.radius_percent) == pytest.approx((0.0, 10.0), rel=1e-3, abs=1e-3)


def test_radius_of_a_run_that_turns_less_than_twenty_degrees_is_not_told() -> None:
    # After the first half second, 2.48 s remain.
    for turned_deg, told in ((19.0, False), (21.0, True)):
        radius = 2.0 * 2.48 / np.radians(turned_deg)
        found = changed(circling(radius, 2.2), circling(radius, 2.0))
        assert found.speed_percent == pytest.approx(10.0, rel=1e-3)
        less = changed(circling(1.01 * radius, 2.02), circling(radius, 2.0))
        assert (less.radius_percent > 0) == told


def test_a_robot_that_crawls_less_than_a_millimetre_has_a_change_of_speed_too() -> None:
    found = changed(circling(5.0, 0.11), circling(5.0, 0.1))
    assert found.speed_percent == pytest.approx(10.0, rel=1e-2)


def test_only_the_settled_part_of_a_run_between_its_commands_tells_radius_and_speed() -> None:
    plain, other = circling(5.0, 2.0), circling(5.0, 2.0)
    other[:24] = circling(5.0, 3.0)[:24] - (circling(5.0, 3.0)[24] - other[24])
    assert changed(other, plain).speed_percent == pytest.approx(0.0, abs=0.05)
    assert changed(other, plain, start_s=-0.1).speed_percent > 0.1
    late = circling(5.0, 2.0)
    late[100:] += np.arange(50)[:, None] * 0.01
    assert changed(late, plain, stop_s=1.98).speed_percent == pytest.approx(0.0, abs=0.01)
    assert changed(late, plain).speed_percent > 0.1


@pytest.mark.parametrize("name", ["path_noise_floors", "radius_percent", "speed_percent"])
def test_an_effect_matters_from_what_is_stated_as_relevant_on(name: str) -> None:
    nothing = relevance.Changes(0.0, 0.0, 0.0)
    least = getattr(Relevant(), name)
    assert not nothing.matter(Relevant())
    assert replace(nothing, **{name: least}).matter(Relevant())
    assert not replace(nothing, **{name: 0.99 * least}).matter(Relevant())
    assert (Relevant().path_noise_floors, Relevant().radius_percent, Relevant().speed_percent) == (0.5, 0.1, 0.1)


def test_knowledge_is_the_fitted_deviation_in_its_unit_with_its_interval() -> None:
    quantity = Quantity("time_base", "seconds of the recording", "1", sigma=1e-4, per_unit=5e-3)
    free = Quantity("plane_scale", "millimetres of the plate", "1", sigma=1e-3, per_unit=0.05)
    effect = column("time_base")  # of an effect of the same name: no quantity
    fit = fit_of(linear_runs(), [effect], np.array([9.0]), TAU, np.eye(1))
    held = fit_of(
        linear_runs(parameters=1), [column("time_base", effect=False)], np.array([0.08]), TAU, np.eye(1) * 4e-4
    )
    turns = Quantity("left_wheel_turns", "turns of the left wheels", "1", sigma=0.01, per_unit=0.05)
    found, stays = knowledge([quantity, free, turns], held)  # without a ripple, turns are no value of the model
    assert (found.found, found.low, found.high) == pytest.approx((4e-4, 4e-4 - 1.96 * 1e-4, 4e-4 + 1.96 * 1e-4))
    assert (stays.found, stays.low, stays.high) == pytest.approx((0.0, -1.96e-3, 1.96e-3))
    assert knowledge([quantity], fit)[0].found == 0.0
    assert found.is_finding
    tail = "tolerance 0.0001 (equivalent to the effects time-base or drive-speed-scale)"
    assert found.sentence == f"seconds of the recording: off by +0.0004 [95 %: 0.0002 to 0.0006], {tail}"
    assert replace(found, quantity=replace(quantity, key="body.mass_g")).alike is None


@pytest.mark.parametrize(("found", "finding"), [(2.9, False), (3.1, True), (-3.1, True)])
def test_a_preference_beyond_three_tolerances_is_a_finding(found: float, finding: bool) -> None:
    quantity = Quantity("start_common_s", "start", "s", sigma=0.01, per_unit=0.5)
    told = Knowledge(quantity, 0.01 * found, 0.0, 0.0)
    assert told.is_finding == finding
    way = "later" if found > 0 else "earlier"
    assert told.sentence == f"motion starts {abs(10 * found):.0f} ms {way} than start_s in all runs"


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 100.0, -70.0])
def test_heading_of_a_run_is_known_by_the_line_of_its_marks_and_side_by_its_wheels(angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    arm = 2 * np.array([np.sin(angle), np.cos(angle)])
    known = _known([replace(run_data(10.0, 30.0), marks_mm=np.array([[*arm, *-arm]]))])
    np.testing.assert_allclose(known["heading"], [[np.cos(angle), np.sin(angle)]], atol=1e-12)
    np.testing.assert_allclose(known["twice the heading"], [[np.cos(2 * angle), np.sin(2 * angle)]], atol=1e-12)
    still = _known([run_data(-20.0, 20.0)])
    assert (still["direction"].item(), still["side"].item()) == (0.0, 1.0)
    assert still["direction and side together"].item() == 0.0


def test_a_run_that_tells_more_than_a_hundredth_of_its_speed_counts() -> None:
    rng = np.random.default_rng(2)
    data = [run_data(30.0, 20.0, number) for number in range(12)]
    own, told = rng.normal(size=(12, 4)), np.ones((12, 4))
    own[:, 1] = 0.05 * np.arange(12) + 1e-3 * rng.normal(size=12)
    told[:, 1] = 0.011
    assert "left gain" in _order(own, told, data, EVERY)[1]
    eight = _order(own[:8], np.ones((8, 4)), data[:8], EVERY)
    assert eight[0] < 1.0  # six degrees of freedom are enough


def test_two_frames_have_no_way_and_no_turn() -> None:
    assert relevance._way_and_turn(np.zeros((2, 4))) == (0.0, 0.0)
    way, turn = relevance._way_and_turn(circling(5.0, 2.0)[:3])
    assert (way, turn) == pytest.approx((2 * 2.0 * 0.02, 2 * 0.4 * 0.02), rel=1e-3)
