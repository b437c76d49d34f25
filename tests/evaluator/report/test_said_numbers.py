"""Sentences and tables of the report: each number is that of its column, in its unit, under its head."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from evaluator.report import sections
from evaluator.report.numbers import METRES, MILLIMETRES, command_text, interval
from evaluator.report.pages.html import Table
from evaluator.report.runs import _by_places_mm
from evaluator.report.sections import _quality, _run_table
from evaluator.report.summary import headline, summary
from evaluator.report.tables import directions_table, outline_table, pooled_table, slip_table, standard_sentence
from tests.evaluator.report.shown import Shown, shown, turned

NONE = pd.DataFrame()


def said(runs: list[Shown], directions: pd.DataFrame = NONE, faults: dict[str, str] | None = None) -> str:
    return " ".join(summary(runs, faults or {}, None, directions))


def test_the_tightest_and_the_widest_turn_are_told_with_their_intervals() -> None:
    """The interval bears one digit of its half; a bound at infinity is a straight path."""
    runs = [turned("wide", 20.0), turned("tight", 8.1234, half=0.03), turned("straight", 1.0, turned_deg=0.9)]
    assert "radius of 8.12 mm (95 %: 8.09 to 8.15 mm; run tight, 30 / 20 rpm)" in said(runs)
    assert "the widest 20.0 mm (run wide, 30 / 20 rpm)." in said(runs)
    large = [replace(turned(name, radius), unit=METRES) for name, radius in (("near", 1583.0), ("far", 1624.0))]
    assert "the widest 1.62 m (run far, 30 / 20 rpm)." in said(large)
    assert "widest" not in said(runs[1:])
    assert "(95 %: 8.10 mm to straight; run" in said([turned("open", 9.0, radius_low_mm=8.1, radius_high_mm=inf)])
    assert "No run turns" in said(runs[2:])


def test_a_short_phase_with_a_wide_interval_is_not_the_tightest_turn() -> None:
    """Of 124 phases of robots of UTIAS the least radius, 3.6 (0 to 8.8) mm, was that of 0.6 s and 6 degrees."""
    runs = [turned("turn", 8.0, half=0.5), turned("phase", 2.2, turned_deg=4.0, half=30.0)]
    assert "radius of 8.0 mm (95 %: 7.5 to 8.5 mm; run turn" in said(runs)
    assert "run turn" in headline(runs)[0].range
    unbounded = [turned("open", 1.0, radius_low_mm=0.5, radius_high_mm=inf), runs[0]]
    assert "run turn" in headline(unbounded)[0].range


def test_simulated_radii_are_counted_within_their_intervals_and_the_worst_is_told_with_its_way() -> None:
    runs = [turned("a", 10.0, 2.0, 10.1), turned("b", 10.0, -5.0, 9.9), turned("c", 10.0, 0.1, 10.11)]
    assert "inside the measured 95 % interval in 2 of 3 turns; at worst it is 5.0 % tighter" in said(runs)
    assert "than measured (run b)." in said(runs)
    assert "at worst it is 2.0 % wider than measured (run a)." in said([runs[0], runs[2]])
    assert "The simulated robot drives straight in the measured turns." in said([turned("d", 10.0, nan, nan)])


def test_the_tolerance_of_the_positions_of_the_marks_is_told_beside_intervals_without_it() -> None:
    """ "0 of 5 turns inside" stood above "nothing is missing", with marks that were glued 0.06 mm off."""
    runs = [replace(turned("a", 10.0, 2.0, 10.15), by_places_mm=0.06), turned("b", 12.0, 2.0, 12.15)]
    text = said(runs)
    assert "a usual error of their positions adds ±0.1 mm (95 %, run a)" in text  # 1.96 x 0.06
    assert "inside the measured 95 % interval in 0 of 2 turns, in 1 with the tolerance of the positions" in text
    assert "tolerance" not in said([replace(runs[0], by_places_mm=0.02), runs[1]])  # 0.039 beside 0.1 mm
    assert "; positions of the marks ±0.1 mm" in headline(runs)[0].range
    assert "positions" not in headline(runs[1:])[0].range


def test_a_mark_that_a_run_does_not_show_makes_no_radius_more_certain() -> None:
    robot: Any = SimpleNamespace(
        points_mm={"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)},
        known_to=SimpleNamespace(states=lambda _: False, mark_position_mm=0.03),
    )
    third: Any = SimpleNamespace(**vars(robot) | {"points_mm": {**robot.points_mm, "blue": (2.0, 1.0)}})
    two = {"green_speed_mm_s": 1.0, "yellow_speed_mm_s": 1.2}
    alone = _by_places_mm(robot, two)
    assert alone > 0.0
    assert _by_places_mm(third, two) == _by_places_mm(third, {**two, "blue_speed_mm_s": None}) == alone
    assert _by_places_mm(third, {**two, "blue_speed_mm_s": 1.1}) < 0.9 * alone
    assert _by_places_mm(robot, {}) == alone  # of results without speeds of marks


def test_speeds_of_straight_runs_are_set_against_the_simulated_ones() -> None:
    runs = [
        shown("slow", 30.0, 30.0, {"simulated_speed_mm_s": 2.0}, speed_mm_s=2.02),
        shown("fast", 60.0, 60.0, {"simulated_speed_mm_s": 4.0}, speed_mm_s=3.9),
        shown("turn", 60.0, 40.0, {"simulated_speed_mm_s": 4.0}, speed_mm_s=1.0),
        shown("rest", 0.0, 0.0, {"simulated_speed_mm_s": 4.0}, speed_mm_s=1.0),
    ]
    assert "agree with the simulation within 2.5 % (largest deviation: run fast)." in said(runs)
    assert "within 1.0 % (largest deviation: run slow)." in said([runs[0], *runs[2:]])
    assert "straight runs" not in said(runs[2:])


@pytest.mark.parametrize(
    ("ratios", "warned"), [((1.029,), ""), ((1.034, 1.0, 1.05), "3 % farther"), ((0.93,), "7 % nearer")]
)
def test_lengths_are_doubtful_where_marks_are_three_per_cent_from_where_they_should_be(
    ratios: tuple[float, ...], warned: str
) -> None:
    found = said([turned(f"r{k}", 9.0, mark_spacing_ratio=ratio) for k, ratio in enumerate(ratios)])
    assert found.startswith(f"The marks are {warned}") == bool(warned)
    assert ("than robot.toml says: either their positions there are off, or all lengths below" in found) == bool(warned)


def test_backward_turns_are_pooled_by_their_intervals_and_differ_where_these_leave_nought_out() -> None:
    def both(*changes: tuple[float, float], runs: int = 2) -> str:
        rows = [
            {
                "forward_runs": 2,
                "backward_runs": runs,
                "radius_change_percent": change,
                "radius_change_low_percent": change - half,
                "radius_change_high_percent": change + half,
            }
            for change, half in changes
        ]
        return said([turned("a", 9.0)], pd.DataFrame(rows))

    assert "Backward turns are 2.0 % tighter than" in both((-2.0, 1.5))
    assert "(95 %: −3.5 to −0.50 %, one pair of commands)" in both((-2.0, 1.5))
    assert "(95 %: +900 to +940 %, one pair of commands)" in both((920.0, 20.0))  # it was +9e+02 to +9.4e+02
    assert "Backward turns are 2.0 % wider than" in both((2.0, 1.5))
    assert "do not differ significantly (95 %: −0.50 to +3.5 %, one pair of commands)" in both((1.5, 2.0))
    many = both((2.9, 1.5), (3.0, 1.5), (3.1, 1.5), (9.0, nan))  # Student's t of 2 degrees: 4.30 · 1.5 / 1.96 / √3
    assert "Backward turns are 3.0 % wider" in many
    assert "(95 %: +1.1 to +4.9 %, 3 pairs of commands)" in many
    assert "Backward" not in both((2.0, nan))
    alone = both((2.4, 0.9), runs=1)  # it was told of all turns, where friction varies by 14 % from run to run
    assert "The backward turn was 2.4 % wider than the forward turn at the same wheel speeds" in alone
    assert "(95 % of the measurement alone: +1.5 to +3.3 %; a single run does not show what varies" in alone
    assert "measurement alone" not in both((2.9, 1.5), (3.0, 1.5), runs=1)


def test_runs_without_a_result_are_counted_among_all_and_five_of_them_named() -> None:
    faults = {f"f{k}": "not readable" for k in range(6)}
    assert "6 of 7 runs gave no result (f0, f1, f2, f3, f4, …); reasons below." in said(
        [turned("a", 9.0)], faults=faults
    )
    assert "1 of 2 runs gave no result (f0); reasons" in said([turned("a", 9.0)], faults={"f0": "dark"})


def cells(table: Table) -> dict[str, tuple[str, ...]]:
    """Columns of a table by their heads."""
    return dict(zip(table.head, zip(*table.rows, strict=True), strict=True))


def numbered(*names: str, first: float = 100.25) -> dict[str, float]:
    """A number of its own for every name."""
    return {name: first + place for place, name in enumerate(names)}


def test_every_column_of_the_run_table_shows_its_own_number() -> None:
    row = numbered("radius_mm", "radius_low_mm", "radius_high_mm", "turned_deg", "speed_mm_s", "yaw_rate_deg_s")
    compared = numbered("simulated_radius_mm", "radius_difference_percent", "gap_rms_mm", first=200.25)
    runs = [
        shown("a", 30.0, -20.5, compared, **row, share_used=0.5, radius_status="ok"),
        shown("b", 30.0, 20.0, compared, **{**row, "turned_deg": 0.9}, radius_status="too short: 2 s"),
    ]
    section = _run_table(runs, {"b"})
    assert section.text == ("b: too short, 2 s.",)
    assert cells(section.tables[0]) == {
        "run": ("a", "b (left out)"),
        "left / right, rpm": ("30 / −20.5", "30 / 20"),
        "radius, mm": ("100.250", "–"),
        "95 %, mm": ("101.250 to 102.250", "–"),
        "simulated, mm": ("200.250",) * 2,
        "difference, %": ("+201.25",) * 2,
        "speed, mm/s": ("104.250",) * 2,
        "yaw rate, deg/s": ("105.25",) * 2,
        "path gap RMS, mm": ("202.250",) * 2,
        "frames used, %": ("50.0", "–"),
    }
    metres = cells(_run_table([replace(runs[0], unit=METRES)], set()).tables[0])
    assert (metres["radius, m"], metres["95 %, m"]) == (("0.100",), ("0.101 to 0.102",))


def test_every_column_of_the_outline_shows_its_own_number() -> None:
    names = ("green_radius_mm", "yellow_radius_mm", "outer_wheel_radius_mm", "wall_to_wall_radius_mm")
    more = {"rotation_x_mm": -1.5, "rotation_y_mm": 9.0, "center_wander_mm": 0.0125, "smoothness": -1.8}
    run = turned("a", 9.0, path_efficiency=0.99, speed_ripple=0.031, **numbered(*names), **more)
    assert cells(outline_table([run])) == {
        "run": ("a",),
        "green, mm": ("100.250",),
        "yellow, mm": ("101.250",),
        "outermost wheel, mm": ("102.250",),
        "wall to wall, mm": ("103.250",),
        "turns about (x, y), mm": ("−1.500, 9.000",),
        "wander of this centre, µm": ("12.5",),
        "path efficiency, %": ("99.00",),
        "speed ripple, %": ("3.1",),
        "smoothness": ("−1.80",),
    }


def test_measured_slips_stand_above_simulated_ones() -> None:
    measured = {"front_right_slip_ratio": 0.1234, "rear_left_slip_angle_deg": -1.25, "body_slip_angle_deg": 2.5}
    compared = {f"simulated_{name}": 2 * value for name, value in measured.items()}
    found = cells(slip_table([shown("a", 30.0, 20.0, compared, **measured)]))
    assert found["slip ratio, front right"] == ("0.1234\n0.2468",)
    assert found["slip angle, rear left, °"] == ("−1.25\n−2.50",)
    assert found["slip angle of the body, °"] == ("2.50\n5.00",)
    assert found["slip ratio, front left"] == ("–\n–",)


def test_repetitions_are_told_with_the_shares_of_what_makes_them_differ() -> None:
    row = {
        "left_rpm": 30.0,
        "right_rpm": 20.0,
        "group": "A",
        "side": "right",
        "direction": "forward",
        "runs": 3,
        "radius_mm": 8.0,
        "radius_low_mm": 7.9,
        "radius_high_mm": 8.2,
        "note": "",
        "radius_between_mm": 0.08,
        "radius_within_mm": 0.04,
        "radius_systematic_mm": 0.02,
    }
    straight = {**row, "side": "", "left_rpm": 9.0}
    found = cells(pooled_table(pd.DataFrame([row, straight]), MILLIMETRES))
    assert {head: values[0] for head, values in found.items()} == {
        "left / right, rpm": "30 / 20 (A)",
        "turn": "right, forward",
        "runs": "3",
        "radius, mm": "8.000",
        "95 %, mm": "7.900 to 8.200",
        "run to run, %": "1.000",
        "noise, %": "0.500",
        "camera, %": "0.250",
    }
    assert len(found["runs"]) == 1
    large = cells(
        pooled_table(pd.DataFrame([{**row, **{f"radius{end}_mm": 8e3 for end in ("", "_low", "_high")}}]), METRES)
    )
    assert (large["radius, m"], large["95 %, m"]) == (("8.000",), ("8.000 to 8.000",))


def test_what_the_standard_asks_for_beyond_these_runs_is_counted_and_named() -> None:
    def of(*notes: str) -> str:
        rows = [{"left_rpm": 30.0 + k, "right_rpm": 20.0, "side": "left", "note": note} for k, note in enumerate(notes)]
        sentence = standard_sentence(pd.DataFrame([*rows, {**rows[0], "side": "", "note": "one side"}]))
        return sentence.removeprefix("ISO 4138 requires turns to both sides and at least three repetitions of each: ")

    assert of("", "") == "fulfilled."
    assert of("", "two repetitions") == "1 of 2 commands have fewer."
    assert of("", "one side", "") == "31 / 20 rpm was driven to one side only."
    assert of("one repetitions, one side", "side") == (
        "1 of 2 commands have fewer; 30 / 20, 31 / 20 rpm were driven to one side only."
    )
    assert "35 / 20, … rpm were" in of(*["side"] * 7)


def test_backward_stands_beside_forward() -> None:
    row = {
        "left_rpm": 30.0,
        "right_rpm": 20.0,
        "group": "",
        "forward_runs": 2,
        "backward_runs": 3,
        "forward_radius_mm": 8.0,
        "backward_radius_mm": 7.5,
        "radius_change_percent": 1.25,
        "radius_change_low_percent": -0.5,
        "radius_change_high_percent": 3.0,
        "forward_smoothness": -1.8,
        "backward_smoothness": -2.1,
        "smoothness_change_low": -0.5,
        "smoothness_change_high": nan,
    }
    (found,) = directions_table(pd.DataFrame([row]), MILLIMETRES).rows
    assert found == (
        *("30 / 20", "2 + 3", "8.000", "7.500", "+1.25", "−0.50 to +3.00", "−1.800", "−2.100", "−0.500 to –"),
    )


def test_quality_tells_what_was_seen_and_how_well(monkeypatch: pytest.MonkeyPatch) -> None:
    for figure in ("scale_check", "lost_frames"):
        monkeypatch.setattr(sections, figure, lambda _runs: None)

    @dataclass(frozen=True)
    class Seen(Shown):
        marks: Any = None
        poses: Any = None

    sigma = {
        f"{name}_{axis}_sigma_mm": [s, s, nan] for name, s in (("green", 0.002), ("yellow", 0.003)) for axis in "xy"
    }
    more = {"residual_rms_mm": 0.0045, "noise_correlation": 0.21, "start_delay_s": 0.017}
    run = turned("a", 9.0, **more)
    seen = Seen(
        *(run.run, "", run.turning, run.comparison, run.outputs),
        marks=pd.DataFrame(sigma), poses=pd.DataFrame({"x_mm": [1.0, nan, 1.0]}),
    )  # fmt: skip
    section = _quality([seen], {"a": ("dark", "short")})
    assert section.text == ("a: dark; short.",)
    assert section.tables[0].caption.startswith("Marks: median standard uncertainty of a coordinate")
    assert cells(section.tables[0]) == {
        "run": ("a",),
        "frames": ("3",),
        "marks seen, %": ("66.7",),
        "green, µm": ("2.00",),
        "yellow, µm": ("3.00",),
        "residual, µm": ("4.50",),
        "frame-to-frame correlation": ("0.21",),
        "start delay, s": ("0.017",),
    }
    assert section.tables[0].caption.endswith(
        "a dash where the recording does not show the robot at rest before it starts."
    )
    del more["start_delay_s"]
    given = replace(seen, turning=turned("a", 9.0, **more).turning, marks=seen.marks[[]])
    unstated = _quality([given], {}).tables[0]  # of marks.csv without uncertainties the caption told of their column
    assert unstated.caption.startswith("Residual: ")
    assert "Start delay" not in unstated.caption
    assert set(unstated.head).isdisjoint({"green, µm", "start delay, s"})


def test_a_run_knows_its_phase_its_command_and_its_way() -> None:
    run = shown("r", -30.0, -20.5, phase=2.0, phase_start_s=1.0, phase_stop_s=2.0)
    assert (run.id, run.command, run.difference_rpm, run.backward, run.straight) == (
        *("r (2)", "−30 / −20.5 rpm", 9.5, True, False),
    )
    assert (shown("r", 30.0, 30.0).id, shown("r", 30.0, -30.0).backward) == ("r", False)
    assert shown("r", 30.0, 30.0).straight
    times = pd.DataFrame({"time_s": [0.5, 1.0 - 1e-7, 1.5, 2.0, 2.1]})
    assert run._of_phase(times)["time_s"].tolist() == [1.0 - 1e-7, 1.5, 2.0]
    assert len(shown("r", 1.0, 1.0)._of_phase(times)) == 5
    assert command_text(nan, 2.0) == "–"
    assert interval(nan, 2.0) == "–"


def test_mistakes_that_only_the_diagnosis_finds_are_told_first_and_why_nothing_explains_the_runs() -> None:
    """ "Nothing is missing" stood at the top of a report whose run r11 had another command than its file says."""
    runs, mistake = [turned("r11", 20.0), turned("r12", 8.0)], {"runs": ["r11"], "sentence": "r11 moves as if so"}
    gone = {"runs": ["r13"], "sentence": "r13 drives backward"}  # it is left out of all results, and told elsewhere
    found: dict[str, Any] = {"verdict": "none", "effects": [], "reason": "so", "mistakes": [mistake, gone]}
    first, verdict, *_ = summary(runs, {}, found, NONE)
    assert first == "r11 moves as if so."
    assert verdict == "Nothing is missing: the model explains these runs within noise, scatter and tolerances."
    without = summary(
        runs, {}, {**found, "left_out_runs": {"r14": "it diverges", "r07": "it alone needs a drag"}}, NONE
    )
    assert any(line.endswith("and tolerances, apart from r07, r14, left out of the diagnosis.") for line in without)
    outside = [turned("a", 10.0, 2.0, 10.3)]
    adjusted = "at worst it is 2.0 % wider than measured (run a). This is with the values of robot.toml; the diagnosis"
    assert adjusted in " ".join(summary(outside, {}, found, NONE))
    assert "This is with" not in " ".join(summary(outside, {}, {**found, "verdict": "insufficient"}, NONE))
    unknown = summary(runs, {}, {**found, "verdict": "unknown", "reason": "the runs a and b are explained apart"}, NONE)
    assert unknown[1].endswith(" explains. The runs a and b are explained apart.")
