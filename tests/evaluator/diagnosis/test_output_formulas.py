"""Numbers and words of diagnosis.json, worked out on paper from a diagnosis made of stand-ins."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.adequacy import Adequacy, Unlike
from evaluator.diagnosis.assessment.gap import Gap
from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.changes.session_changes import FrictionChange
from evaluator.diagnosis.design.candidate_runs import CandidateRun
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.output import alternatives_json, diagnosis_json, effects_json, unlike_runs
from evaluator.diagnosis.output.effect_tables import effect_tables
from evaluator.diagnosis.output.own_effect import own_effects
from evaluator.diagnosis.output.robot_with_effect import robot_with_effect
from simulator.effects.coordinates import Candidate, Coordinate
from simulator.robot import shipped_robot_text
from tests.evaluator.diagnosis.synthetic import column, linear_runs

BOTH = ["drive-speed-mismatch", "drive-speed-scale"]
NONE, A, AB, B = frozenset[str](), frozenset({"a"}), frozenset({"a", "b"}), frozenset({"b"})


def test_numbers_have_six_digits_and_what_is_not_finite_is_null() -> None:
    assert effects_json.rounded(1234.5678) == 1234.57
    assert [effects_json.rounded(value) for value in (math.nan, math.inf, None)] == [None, None, None]
    assert diagnosis_json._changes(Changes(1.2345, 2.3456, 3.4567)) == {
        "path_noise_floors": 1.23,
        "radius_percent": 2.35,
        "speed_percent": 3.46,
    }


def test_effects_nearer_than_four_sigmas_are_equivalent_the_nearest_first() -> None:
    found: Any = SimpleNamespace(separation={"a": {"": 3.0, "b": 3.9, "c": 4.1, "d": 1.0}})
    assert effects_json.equivalents(found, "a") == ["d", "b"]
    assert effects_json.equivalents(found, "e") == []


RUNS = [
    SimpleNamespace(id=f"r{k}", time_s=np.array([1.0, 5.0]), left_rpm=30.0, right_rpm=20.0, log=None) for k in range(3)
]


@pytest.mark.parametrize(("gain", "sigmas"), [(8.0, 4.0), (-3.0, 0.0), (math.nan, None)])
def test_gaps_are_those_of_fitted_and_of_held_out_runs(gain: float, sigmas: float | None) -> None:
    before, after, floor = np.array([3.0, 4.0, 9.0]), np.array([0.3, 0.4, 0.9]), np.array([0.1, 0.1, 0.2])
    gap = Gap(before, after, floor, 10 * before, 20 * after, {1: "it turns over"})
    found: Any = SimpleNamespace(gap=gap, fit_search=SimpleNamespace(runs=(0, 1)), held_out=(2,), confirmation=gain)
    found.session = SimpleNamespace(data=RUNS)
    said = diagnosis_json._gap(found)
    assert said["held_out_runs"] == ["r2"]
    assert said["before"] == pytest.approx({"fit": np.sqrt(12.5), "held_out": 9.0}, rel=1e-5)
    assert said["after"] == pytest.approx({"fit": np.sqrt(0.125), "held_out": 0.9}, rel=1e-5)
    assert said["predicted"]["before"]["held_out"] == 90.0
    assert said["predicted"]["after"]["held_out"] == 18.0
    assert said["noise_floor"] == pytest.approx(np.sqrt(0.02), rel=1e-5)
    assert said["held_out_gain_sigmas"] == sigmas
    assert said["by_run"]["r1"] == {"before": 4.0, "after": 0.4, "noise_floor": 0.1}
    assert said["not_predicted"] == {"r1": "it turns over"}
    assert said["elsewhere"] == []
    found.gap = replace(gap, elsewhere=(1,))
    said = diagnosis_json._gap(found)
    assert (said["elsewhere"], said["before"]["fit"], said["noise_floor"]) == (
        ["r1"],
        3.0,
        pytest.approx(0.158, abs=1e-3),
    )


def test_noise_of_a_mark_is_that_of_the_midpoint_of_two_without_their_common_drift() -> None:
    drift = Drift(0.003, 1e9)
    parts = [(Noise(white, 0.0, 0.25, NO_DRIFT, drift),) for white in (0.004, 0.005, 0.009)]
    problem = SimpleNamespace(noise=parts, common_drift=drift, data=RUNS, friction_wander=0.01, open_ground=False)
    problem.smoothed_over = 9
    reduced = reduce_runs(linear_runs(8, 1))
    ends = MixedModel(reduced, np.zeros(1)).scatter_interval([0])
    friction, gain = np.sqrt(ends.prod(axis=1))
    fit = SimpleNamespace(posterior=SimpleNamespace(scatter=np.array([friction, gain, gain, 1.0])), reduced=reduced)
    fit.columns, fit.runs = (column("a"),), ()
    found: Any = SimpleNamespace(problem=problem, fit=fit, search=SimpleNamespace(tolerance={}), session=None)
    said = diagnosis_json._noise(found)
    assert said["mark_sigma_mm"] == pytest.approx(0.005 * np.sqrt(2), rel=1e-5)
    assert said["friction_in_10_mm"] == pytest.approx(0.01 * np.sqrt(10), rel=1e-5)
    assert said["common_drift_mm"] == pytest.approx(drift.about_mean_mm(4.0), rel=1e-4)
    assert said["correlation_s"] == 0.25
    assert said["smoothed"]
    between = said["run_to_run"]
    assert (between["friction"], between["wheel_speed"]) == pytest.approx((friction, gain), rel=1e-5)
    assert [between["friction_95"], between["wheel_speed_95"]] == [pytest.approx(end, rel=1e-5) for end in ends]
    fit.posterior.scatter = np.array([0.5, 1e-5, 1e-5, 1.0])  # beside an effect at a bound, which the interval ignores
    between = diagnosis_json._noise(found)["run_to_run"]
    assert between["friction_95"] == pytest.approx([ends[0, 0], 0.5], rel=1e-5)
    assert between["wheel_speed_95"] == pytest.approx([1e-5, ends[1, 1]], rel=1e-5)
    problem.open_ground = True
    assert diagnosis_json._noise(found)["run_to_run"] is None


def test_adjusted_values_and_shared_errors_are_told_apart_in_their_units() -> None:
    columns = (Column("body.mass_g"), Column("camera, error 1"))
    point = Point(np.zeros((1, 7)), {"body.mass_g": 0.03, "camera, error 1": 0.05})
    fit = SimpleNamespace(columns=columns, point=point, posterior=SimpleNamespace(covariance=np.diag([1e-4, 4e-4])))
    tolerance = {"body.mass_g": 0.05, "camera, error 1": 0.02}
    found: Any = SimpleNamespace(fit=fit, session=SimpleNamespace(tolerance=tolerance))
    assert diagnosis_json._nominal(found) == {
        "body.mass_g": {"relative_change": 0.03, "sigma": 0.01, "tolerance": 0.05}
    }
    assert diagnosis_json._shared(found) == {"camera, error 1": 2.5}  # standard deviations


def test_a_disagreement_has_the_length_of_its_sizes_and_its_significance_after_the_answer() -> None:
    item = SimpleNamespace(quantity="yaw_deg_s", by="heading", parity="", sigmas=9.0, sentence="it turns")
    item.sizes = ((3.0, 2.0, 4.0), (4.0, 3.0, 5.0))
    after = SimpleNamespace(quantity="yaw_deg_s", by="heading", parity="", sigmas=1.5)
    apart: Any = [SimpleNamespace(run=run, quantity=name) for run, name in (("r1", "yaw_rate"), ("r2", "along"))]
    found: Any = SimpleNamespace(where=(item,), left=(after,))
    (said,) = diagnosis_json._where(found, apart)
    assert (said["size"], said["unit"], said["sigmas"], said["after_sigmas"]) == (5.0, "deg/s", 9.0, 1.5)
    assert (said["quantity"], said["runs"], said["parity"]) == ("yaw_rate", ["r1"], None)


def test_pieces_carry_what_is_left_and_whether_they_were_held_out() -> None:
    before = pd.DataFrame({"run": ["r0", "r2"], **dict.fromkeys(diagnosis_json.QUANTITIES, (1.0, 2.0))})
    found: Any = SimpleNamespace(pieces=before, pieces_after=before.assign(along_mm_s=[0.1, 0.2]), held_out=(2,))
    found.session = SimpleNamespace(data=RUNS)
    table = diagnosis_json.disagreement(found)
    assert table is not None
    assert table["kept_aside"].tolist() == [False, True]
    assert (table["along_mm_s"].tolist(), table["after_along_mm_s"].tolist()) == ([1.0, 2.0], [0.1, 0.2])


TOO_LARGE = "would be larger than is plausible: at a bound of the size"


@pytest.mark.parametrize(
    ("chosen", "ids", "odds", "reason"),
    [
        (A, NONE, -math.log(5.0), "without any effect the runs are 5.0 times less probable"),
        (AB, B, -math.log(30.0), "leaving out a makes the runs 30 times less probable"),
        (A, AB, 3.0, "adding b is not significant"),
        (A, AB, 9.0, "not every effect in it is worth odds of 3000 to 1 beside the others"),
        (A, B, -math.log(1e6), "makes the runs 10⁶ times less probable"),
        (A, B, 2.0, "not every effect in it is worth odds of 3000 to 1 beside the others"),
    ],
)
def test_a_rival_has_its_odds_and_the_reason_against_it(
    chosen: frozenset[str], ids: frozenset[str], odds: float, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alternatives_json, "strained", lambda *_: {"b", "a"})
    table = Standing((chosen, ids), np.array([7.0, 7.0 + odds]))
    rival = SimpleNamespace(at_bounds=frozenset[str]())
    fits = {chosen: 0, ids: rival}
    search = SimpleNamespace(fits=fits, null=0, tolerance={}, problem=SimpleNamespace(open_ground=False))
    found: Any = SimpleNamespace(standing=table, chosen=chosen, search=search)
    (said,) = alternatives_json.rivals(found)
    assert (said["effects"], said["reason"], said["strains"]) == (sorted(ids), reason, ["a", "b"])
    rival.at_bounds = frozenset({"b"})
    told = alternatives_json.rivals(found)[0]["reason"]
    assert told == (f"b {TOO_LARGE}" if "not every effect" in reason else reason)
    assert said["log_odds"] == pytest.approx(odds, rel=1e-5)
    assert said["probability"] == pytest.approx(1 / (1 + math.exp(-odds)), abs=1e-4)


@pytest.mark.parametrize(
    ("odds", "carries", "reason"),
    [
        (0.5, False, "an effect in it predicts commands left out no better than chance"),
        (2.0, True, "not every effect in it is worth odds of 3000 to 1 beside the others"),
        (-math.log(50.0), False, "makes the runs 50 times less probable"),
    ],
)
def test_on_open_ground_a_rival_that_fits_better_has_to_carry_over(
    odds: float, carries: bool, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alternatives_json, "strained", lambda *_: set())
    monkeypatch.setattr(alternatives_json, "carries_over", lambda *_: carries)
    fits = {A: 0, B: SimpleNamespace(at_bounds=())}
    search = SimpleNamespace(fits=fits, null=0, tolerance={}, problem=SimpleNamespace(open_ground=True))
    found: Any = SimpleNamespace(standing=Standing((A, B), np.array([7.0, 7.0 + odds])), chosen=A, search=search)
    (said,) = alternatives_json.rivals(found)
    assert (said["reason"], said["carries_over"]) == (reason, carries)


@pytest.mark.parametrize(("left", "ids"), [(0.95, ["drive-speed-mismatch"]), (0.975, BOTH)])
def test_two_effects_of_one_cause_are_told_once_by_its_name(
    left: float, ids: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The right wheel turns as commanded, or 2.5 % faster; each is known to 0.5 %."""
    rng, right = np.random.default_rng(1), 1.0 if left == 0.95 else 1.025
    speeds = np.array([left, right])[:, None] + 0.005 * rng.normal(size=(2, 4000))
    draws = {"left_over_right": speeds[0] / speeds[1], "factor": speeds.mean(axis=0)}
    monkeypatch.setattr(effects_json, "_drawn", lambda *_: draws)
    found: Any = SimpleNamespace(verdict="effect", terms=dict.fromkeys(BOTH))
    content: Any = [{"id": name, "name": name} for name in BOTH]
    said = effects_json._without_repetition(content, found)
    assert [item["id"] for item in said] == ids
    assert ("the left wheel alone is off" in said[0]["name"]) == (len(ids) == 1)
    found.verdict = "unknown"
    assert effects_json._without_repetition(content, found) == content


def test_a_robot_file_gets_the_effect_with_its_interval_and_the_values_that_moved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = {"x_mN": {"value": 1.5, "low": 1.25, "high": None}}
    monkeypatch.setattr("evaluator.diagnosis.output.robot_with_effect.parameters", lambda *_: known)
    text = shipped_robot_text("barrel")
    item = Candidate("tether-pull", (Coordinate("x_mN", 0.0, 0.1),), lambda values: {"x_mN": values[0], "y_mN": 0.0})
    nominal = {"slip.lateral_friction": 0.1, "body.mass_g": 1e-9, "camera, error 1": 0.5}
    point = Point(np.zeros((1, 7)), nominal, {"tether-pull": (1.5,)})
    found: Any = SimpleNamespace(terms={"tether-pull": item}, chosen=frozenset({"tether-pull"}))
    found.fit = SimpleNamespace(point=point)
    # as stated: the last search does without those that its noise hides, and may have loosened others
    found.session = SimpleNamespace(tolerance={"slip.lateral_friction": 0.04, "body.mass_g": 0.02})
    found.search = SimpleNamespace(tolerance={})
    written = robot_with_effect(found, text)
    assert "\nx_mN = 1.5  # 95 %: 1.25 to unknown\ny_mN = 0.0\n" in written
    before, after = tomllib.loads(text), tomllib.loads(written)
    assert after.pop("effect") == [{"id": "tether-pull", "x_mN": 1.5, "y_mN": 0.0}]
    assert after["slip"].pop("lateral_friction") == pytest.approx(1.1 * before["slip"].pop("lateral_friction"))
    assert after == before
    assert (
        written.count("which adjusted it by 2.5 tolerances") == written.count("which adjusted it") == 1
    )  # a billionth of the mass is rounding


def test_every_table_of_a_form_has_the_interval_of_its_share() -> None:
    form = free_terms()["free:friction.one.driven-left-right"]
    known = {name: {"value": 0.5, "low": 0.25, "high": 0.75} for name in form.physical((0.5,))}
    lines = effect_tables({form.id: form}, {form.id: (0.5,)}, {form.id: known})  # type: ignore[dict-item]
    assert [line for line in lines if line.startswith("coefficient")] == [
        "coefficient = 0.5  # 95 %: 0.25 to 0.75",
        "coefficient = -0.5  # 95 %: -0.75 to -0.25",
    ]


def test_a_form_is_written_as_an_effect_where_the_model_follows_the_runs() -> None:
    form = free_terms()["free:friction.one.driving"]
    fit = SimpleNamespace(point=SimpleNamespace(terms={form.id: (0.25,)}))
    found: Any = SimpleNamespace(
        chosen=frozenset({form.id, "a"}),
        terms={form.id: form, "a": None},
        fit=fit,
        follows=True,
        search=SimpleNamespace(evidence=len),
    )
    (text,) = own_effects(found)
    assert 'channel = "friction"' in text
    assert 'pattern = "driving"' in text
    found.follows = False
    assert own_effects(found) == []
    found.follows, found.chosen = True, frozenset({"a"})
    assert own_effects(found) == []


def test_runs_to_make_next_are_counted() -> None:
    run, other = CandidateRun(30.0, 20.0, 45.0, 1.0, 2.0, 6.0), CandidateRun(20.0, 30.0, 45.0)
    following = SimpleNamespace(runs=(run, other, run), sigmas={"b": 5.1234567}, inseparable={"c": 0.5})
    found: Any = SimpleNamespace(next_runs=following)
    said = alternatives_json.next_experiment(found)
    assert said is not None
    assert [(item["left_rpm"], item["right_rpm"], item["times"]) for item in said["runs"]] == [(30, 20, 2), (20, 30, 1)]
    place = {"x_mm": 1.0, "y_mm": 2.0, "heading_deg": 45.0, "duration_s": 6.0}
    assert place.items() <= dict(said["runs"][0]).items()
    assert (said["separation_sigmas"], said["inseparable_sigmas"]) == ({"b": 5.12346}, {"c": 0.5})


@pytest.mark.parametrize(
    ("what", "change", "said"),
    [
        ("left_gain", 0.011, "r0, r2: the left wheels turn 1.1 % faster than in the other runs"),
        ("right_gain", -0.02, "r0, r2: the right wheels turn 2 % slower than in the other runs"),
        ("right_gain", 0.009, None),  # less than the user counts as relevant
        ("friction", 0.009, "r0, r2: friction is 0.9 % higher than in the other runs"),
        ("friction", -0.3, "r0, r2: friction is 30 % lower than in the other runs"),
    ],
)
def test_runs_unlike_the_others_are_told_with_sign_and_size(
    what: str, change: float, said: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unlike_runs, "unlike_runs", lambda *_: [Unlike((0, 2), what, change)])
    monkeypatch.setattr(unlike_runs, "unlike_repeats", lambda *_: [])
    monkeypatch.setattr(unlike_runs, "friction_change", lambda *_: None)
    session = SimpleNamespace(data=RUNS, robots=(0, 0, 0), relevant=SimpleNamespace(speed_percent=1.0))
    found: Any = SimpleNamespace(leftover=0, follows=True, verdict="none", session=session)
    found.fit = SimpleNamespace(runs=(0, 1, 2))
    assert [item["sentence"] for item in unlike_runs.unlike(found)] == ([said] if said else [])
    found.verdict = "unknown"  # then they mean nothing
    assert unlike_runs.unlike(found) == []


def test_a_run_unlike_the_others_of_its_command_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run repeats another with the same command and robot; a log of commands is repeated by none."""
    asked: list[list[tuple[object, ...]]] = []

    def repeats(_: object, __: object, commands: list[tuple[object, ...]]) -> list[Unlike]:
        asked.append(commands)
        return [Unlike((1,), what, 0.14, of_command=True) for what in ("left_gain", "right_gain")]

    monkeypatch.setattr(unlike_runs, "unlike_runs", lambda *_: [Unlike((1, 2), "left_gain", 0.1)])
    monkeypatch.setattr(unlike_runs, "unlike_repeats", repeats)
    monkeypatch.setattr(unlike_runs, "friction_change", lambda *_: None)
    data = [*RUNS, SimpleNamespace(**{**vars(RUNS[0]), "id": "r3", "log": "a log"})]
    session = SimpleNamespace(data=data, robots=("a", "b", "a", "a"), relevant=SimpleNamespace(speed_percent=1.0))
    found: Any = SimpleNamespace(leftover=0, follows=True, verdict="none", session=session)
    found.fit = SimpleNamespace(runs=(0, 1, 2, 3))
    assert [item["sentence"] for item in unlike_runs.unlike(found)] == [
        "r1, r2: the left wheels turn 10 % faster than in the other runs",
        "r1: the right wheels turn 14 % faster than in the other runs of its command",
    ]
    first, second, third, fourth = asked[0]
    assert first == third
    assert len({first, second, fourth}) == 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (FrictionChange((1, 2), -0.153, once=True), "from r1 on, friction is 15 % lower than before: was the plate"),
        (FrictionChange((0, 1, 2), 0.08, once=False), "friction rises by 8 % over the session, from r0 to r2: clean"),
    ],
)
def test_friction_that_changes_over_the_session_is_told_beside_runs_unlike_the_others_after_it(
    change: FrictionChange, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Adequacy] = []

    def unlike(left: Adequacy, _: object) -> list[Unlike]:
        asked.append(left)
        return [Unlike((2,), "friction", -0.2)]

    monkeypatch.setattr(unlike_runs, "unlike_runs", unlike)
    monkeypatch.setattr(unlike_runs, "friction_change", lambda *_: change)
    runs = [SimpleNamespace(**vars(run), order=number) for number, run in enumerate(RUNS)]
    session = SimpleNamespace(data=runs, robots=(0, 0, 0), relevant=SimpleNamespace(speed_percent=1.0))
    fit = SimpleNamespace(runs=(0, 1, 2))
    left = Adequacy(1.0, 0.0, np.ones(3), np.zeros((3, 4)), np.ones((3, 4)), 1.0, "")
    told, odd = unlike_runs.unlike(
        SimpleNamespace(leftover=left, follows=True, verdict="none", session=session, fit=fit)
    )  # type: ignore[arg-type]
    assert told["sentence"].startswith(said)
    assert told["runs"] == [f"r{run}" for run in change.runs]
    assert odd["sentence"] == "r2: friction is 20 % lower than in the other runs"
    # A change that is told does not make the runs before it unlike those after.
    assert asked[0].random_effects[:, 0] == pytest.approx([0, 0.153, 0.153] if change.once else [0, -0.04, -0.08])
