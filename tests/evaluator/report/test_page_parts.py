"""Parts of a report: facts, footer, player, sections that are there where runs have data, and the style of lines."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.report import build, player, sections, style
from evaluator.report.figures import quality, radius
from evaluator.report.numbers import METRES
from evaluator.report.pages import colors
from evaluator.report.pages.html import Page, Section, page_html
from evaluator.report.runs import unit_of
from evaluator.report.style import Line, drawing, mark_lines, plain_svg
from simulator.robot import load_robot
from tests.evaluator.report.shown import Shown, labels, lines, shown, turned, undrawn

BARREL = load_robot("barrel")


def analysis_of(*kinds: str, **more: Any) -> Any:
    """An experiment with a run for each kind: video, marks or poses."""
    runs = [
        SimpleNamespace(
            id=f"r{k}", video="v" if kind == "video" else None, poses="p" if kind == "poses" else None, camera=None,
            commands="c" if kind == "log" else None,
        )
        for k, kind in enumerate(kinds)
    ]  # fmt: skip
    return SimpleNamespace(experiment=SimpleNamespace(run=runs, notes="a note", robot="barrel"), faults={}, **more)


@pytest.mark.parametrize(
    ("kinds", "shown_runs", "facts"),
    [
        (("video", "video"), 2, "2 runs, from video"),
        (("marks",), 1, "1 run, from marks"),
        (("poses", "poses"), 1, "1 of 2 runs, from poses"),
        (("video", "marks", "marks"), 3, "3 runs, 1 from video"),
        (("poses", "marks"), 2, "2 runs, from marks"),
    ],
)
def test_the_head_of_a_report_counts_runs_and_says_what_they_are_from(
    kinds: tuple[str, ...], shown_runs: int, facts: str
) -> None:
    runs = [turned(f"r{k}", 9.0) for k in range(shown_runs)]
    phases = [*runs, replace(runs[0], turning={**runs[0].turning, "phase": 2})]  # a phase more is no run more
    assert build._facts(analysis_of(*kinds), phases, BARREL) == (f"robot: {BARREL.name}", facts, "a note")


def test_the_foot_of_a_report_names_versions_and_a_dozen_digits_of_the_code() -> None:
    provenance = {"turnscope": "1.2", "code_sha256": "0123456789abcdef", "python": "3.11", "libraries": {"numpy": "2"}}
    assert build._footer(provenance) == (
        "Made by turnscope 1.2 (code 0123456789ab) with Python 3.11, numpy 2. Hashes of all inputs: provenance.json."
    )
    assert build._footer({**provenance, "turnscope": "unknown"}).startswith("Made by turnscope (code")


def test_cameras_are_those_of_videos_with_results_each_once() -> None:
    found = analysis_of("video", "video", "video", "marks")
    for run, camera in zip(found.experiment.run, ("a.json", "a.json", "b.json", "c.json"), strict=True):
        run.camera = Path(camera)
    found.faults = {"r2": "dark"}
    assert build._cameras(found) == [Path("a.json")]


@dataclass(frozen=True)
class Seen(Shown):
    """A run with curves and without thumbnails."""

    marks: Any = None
    poses: Any = None
    simulated: Any = None
    thumbnails: Any = ()


def seen(run: Shown, count: int = 3) -> Seen:
    time = np.arange(count) / 60
    poses = pd.DataFrame({"time_s": time, "x_mm": 1.23456, "y_mm": -2.34567, "heading_deg": 45.678})
    poses.loc[1, "x_mm"] = nan
    marks = pd.DataFrame({f"{name}_{axis}_mm": 3.14159 for name in run.mark_names for axis in "xy"}, index=range(count))
    curves = {"marks": marks, "poses": poses, "simulated": poses.fillna(9.87654)}
    return Seen(run.run, run.group, run.turning, run.comparison, run.outputs, run.unit, **curves)


def test_the_player_has_rounded_curves_gaps_as_null_and_the_circle_of_a_turn() -> None:
    turn = {"center_x_mm": 1.23456, "center_y_mm": 2.0}
    straight = seen(turned("b", nan, radius_status="straight: -0.1 1/m"))
    runs = [replace(seen(turned("a", 5.6789, **turn)), group="wet"), straight]
    content = json.loads(player.player_data(runs, BARREL))
    first, second = content["runs"]
    assert (first["label"], first["note"]) == ("a: 30 / 20 rpm (wet)", "30 / 20 rpm, radius 5.68 mm.")
    assert (second["label"], second["note"]) == ("b: 30 / 20 rpm", "30 / 20 rpm, straight: −0.1 1/m.")
    assert (first["t"], first["x"], first["heading"]) == ([0.0, 0.017, 0.033], [1.23, None, 1.23], [45.7] * 3)
    assert (first["sx"], first["marks"]) == ([1.23, 9.88, 1.23], [[[3.14] * 3] * 2] * 2)
    assert (first["circle"], second["circle"]) == ([1.235, 2.0, 5.679], None)
    assert content["unit"] == {"name": "mm", "mm": 1.0}
    assert [mark["place"] for mark in content["robot"]["marks"]] == [list(mark.place_mm) for mark in BARREL.layout]
    assert [line["color"] for line in content["lines"]] == ["green", "yellow", "ink", "vermillion", "blue"]


@pytest.mark.parametrize(("budget", "points"), [(100_000, 240), (400, 100), (10, 40)])
def test_runs_share_the_points_of_the_page_and_have_forty_to_240(
    budget: int, points: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player, "POINT_BUDGET", budget)
    content = json.loads(player.player_data([seen(turned("a", 5.0), 1200)] * 4, BARREL))
    assert len(content["runs"][0]["t"]) == points + 1  # and the last one


@pytest.mark.parametrize(
    ("count", "player", "listed"), [(2, "", ()), (3, "", ("s0", "s1", "s2")), (3, "{}", ("player", "s0", "s1", "s2"))]
)
def test_a_page_of_several_sections_begins_with_links_to_them(count: int, player: str, listed: tuple[str, ...]) -> None:
    sections = tuple(Section(f"s{k}", f"Part {k}") for k in range(count))
    text = page_html(Page("kind", "title", (), ("said",), sections, "foot", player=player))
    contents = text.partition('class="contents screen"')[2].partition("</nav>")[0]
    assert tuple(re.findall('href="#([^"]*)"', contents)) == listed
    assert all(text.count(f'id="{name}"') == 1 for name in listed)
    assert all(f">Part {k}</a>" in contents for k in range(count if listed else 0))


def test_sections_are_there_where_runs_have_data(monkeypatch: pytest.MonkeyPatch) -> None:
    none = pd.DataFrame()
    assert sections._figures("a", "A", None, None) is None
    assert sections._repetitions([], analysis_of(pooled=none)) is None
    straight = pd.DataFrame({"side": [""]})
    assert sections._repetitions([], analysis_of(pooled=straight)) is None
    one_way = {"pooled_table": "pooled", "directions_table": "directions", "standard_sentence": "ISO"}
    for name, told in one_way.items():
        monkeypatch.setattr(sections, name, lambda *_, told=told: told)
    monkeypatch.setattr(sections, "repetitions", lambda *_: None)
    turns = pd.DataFrame({"side": ["left"]})
    found = sections._repetitions([], analysis_of(pooled=turns, directions=none))
    assert found is not None
    assert (found.text, found.tables, found.figures) == (("ISO",), ("pooled",), ())
    both = sections._repetitions([], analysis_of(pooled=turns, directions=turns))
    assert both is not None
    assert both.tables == ("pooled", "directions")

    def no_turn(*_: Any) -> None:
        raise InputError("no turn")

    monkeypatch.setattr(sections, "circular_test_of", no_turn)
    assert sections._circular_test(analysis_of(), BARREL) is None


def test_wheels_are_drawn_for_one_turn_forward_and_one_backward(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[tuple[Any, ...]] = []
    monkeypatch.setattr(sections, "wheel_states_figure", lambda *given: drawn.append(given[:2]) or "figure")
    monkeypatch.setattr(sections, "steady_turn", lambda *_: None)
    monkeypatch.setattr(sections, "slip_table", lambda runs: [run.run for run in runs])
    commands = {"a": (30.0, 20.0), "b": (-30.0, -20.0), "c": (25.0, 10.0), "d": (9.0, 9.0), "e": (-25.0, -10.0)}
    runs = [turned(name, 9.0, simulated=nan if name == "b" else 9.1) for name in commands]
    for run in runs:
        run.turning.update(zip(("left_rpm", "right_rpm"), commands[run.run], strict=True))
    runs[3].turning["turned_deg"] = 0.0
    found = sections._wheels(runs, BARREL)
    assert found is not None
    assert drawn == [("wheels-forward", "Forward, 30 / 20 rpm"), ("wheels-backward", "Backward, −25 / −10 rpm")]
    assert found.tables == (["a", "b", "c", "e"],)
    assert sections._wheels(runs[3:4], BARREL) is None


def test_the_budget_is_that_of_the_tightest_turn_with_a_command_and_marks_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sections, "budget_of", lambda _, __, run: run)
    monkeypatch.setattr(sections, "budget_section", lambda run, budget: (run.run, budget))
    turns = [turned("r0", 9.0), turned("r1", 5.0), turned("r2", 4.0), turned("r3", 3.0)]
    found = analysis_of("video", "marks", "log", "poses", outputs=None)
    assert sections._budget(turns, found) == ("r1", "r1")
    assert sections._budget(turns[2:], found) is None


def test_a_run_without_a_result_has_its_reason_and_groups_a_column() -> None:
    runs = [turned("a", 9.0, radius_status="ok"), replace(turned("b", 9.0, radius_status="short: -1 s"), group="wet")]
    section = sections._run_table(runs, set())
    assert section.text == ("b: short, −1 s.",)
    assert section.tables[0].head[-1] == "group"
    assert "for a quarter turn, or over the whole of a shorter turn" in section.tables[0].caption
    assert sections._sentences(("sound: so", "", "sound: so.", "next")) == ("Sound: so.", "Next.")
    assert (unit_of([]).name, unit_of([replace(runs[0], unit=METRES)]).name) == ("mm", "m")


def test_ratios_have_ticks_within_their_curve_and_radii_room_above_and_below(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, radius)
    runs = [turned("a", 8.0), turned("b", 9.0), turned("spot", 1.0), turned("rest", 1.0)]
    speeds = {"a": (20.0, 40.0), "b": (40.0, 38.4), "spot": (30.0, -30.0), "rest": (0.0, 0.0)}
    for run in runs:
        run.turning.update(zip(("left_rpm", "right_rpm"), speeds[run.run], strict=True))
    figure = radius.radius_against_ratio(runs)
    assert figure is not None
    assert figure.data["ratio"].tolist() == pytest.approx([0.5, 0.04])  # neither on the spot nor at rest
    curve, _ = lines(axes[0])[-1]
    assert (curve[0], curve[-1], len(curve)) == (pytest.approx(0.04), pytest.approx(0.7), 100)
    assert axes[0].set_xticks.call_args.args[0] == [0.05, 0.1, 0.2, 0.3, 0.5, 0.7]
    assert axes[0].set_ylim.call_args.args == (1 / 1.15, 2 * 1.15)
    assert labels(axes[0]) == ("ratio of difference to the faster wheel", "minimum turning radius, mm")
    np.testing.assert_allclose(lines(axes[0])[0], ([0.5, 0.04], [0.0, 0.0]))
    assert axes[0].set_xscale.call_args.args == axes[0].set_yscale.call_args.args == ("log",)
    assert np.isnan(radius._ratio(runs[3]))


@pytest.mark.parametrize(
    ("count", "named"),
    [(12, list(range(12))), (13, [0, 2, 4, 6, 8, 10, 12]), (30, [0, 3, 6, 9, 12, 15, 18, 21, 24, 27])],
)
def test_of_many_runs_every_so_many_is_named_on_the_axis(
    count: int, named: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    axes = undrawn(monkeypatch, quality)
    quality.scale_check([turned(f"r{k}", 9.0, mark_spacing_ratio=1.0 + k / 100) for k in range(count)])
    places, names = axes[0].set_xticks.call_args.args
    assert (places.tolist(), names) == (named, [f"r{k}" for k in named])
    order, off, _ = axes[0].errorbar.call_args.args
    np.testing.assert_allclose((order, off), (np.arange(count), np.arange(count)), atol=1e-9)
    assert axes[0].axhline.call_args.args == (0,)


def test_lost_frames_are_strokes_in_the_row_of_their_run(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, quality)
    poses = pd.DataFrame({"time_s": [0.0, 0.5, 1.0], "x_mm": [nan, 1.0, nan], "status": "lost"})
    runs = [replace(seen(turned(name, 9.0)), poses=poses) for name in "ab"]
    assert quality.lost_frames(runs) is not None
    assert [call.args for call in axes[0].hlines.call_args_list] == [(0, 0, 1.0), (-1, 0, 1.0)]
    times, heights = np.transpose([call.args for call in axes[0].plot.call_args_list], (1, 0, 2))
    np.testing.assert_allclose(times, [[0.0] * 3 + [1.0] * 3] * 2)
    np.testing.assert_allclose(heights, [[-0.3, 0.3, nan] * 2, [-1.3, -0.7, nan] * 2])
    assert axes[0].set_yticks.call_args.args[0].tolist() == [0, -1]
    assert axes[0].set_ylim.call_args.args == (-1.6, 0.6)


def test_lines_have_the_color_of_their_name_and_dashes_in_widths() -> None:
    named = mark_lines(["left", "green_left", "blue", "rear_two"])
    assert [(line.color, line.text) for line in named] == [
        ("green", "left mark"), ("green", "green left mark"), ("blue", "blue mark"), ("orange", "rear two mark"),
    ]  # fmt: skip
    assert Line("ink", "x", 2.0, (3.0, 1.5)).dasharray == "6 3"
    assert Line("ink", "x", 2.0).dasharray == "none"
    assert Line("ink", "x", 2.0, (3.0, 1.5)).drawn == {"color": colors.INK, "lw": 2.0, "ls": (0, (3.0, 1.5))}
    assert Line("blue", "x", 0.8).drawn["ls"] == "-"


def test_labels_in_a_script_that_matplotlib_has_no_letters_of_are_drawn_without_a_warning() -> None:
    with drawing("a") as canvas:
        canvas.axes[0].set_title("運転 1")
    assert "運転 1" in canvas.svg


def test_a_label_that_would_be_cut_off_is_broken_in_its_middle_and_colors_follow_the_page() -> None:
    with drawing("a", width=1.6, height=1.6) as canvas:
        canvas.axes[0].set_ylabel("a label that is much too long for it")
        canvas.axes[0].set_xlabel("short")
        canvas.axes[0].plot([0, 1], [0, 1], color=colors.BLUE)
    assert canvas.axes[0].get_ylabel() == "a label that is much\ntoo long for it"
    assert canvas.axes[0].get_xlabel() == "short"
    assert f"var(--blue, {colors.BLUE})" in canvas.svg
    plain = plain_svg(canvas.svg)
    assert colors.BLUE in plain
    assert "var(" not in plain
    assert '<rect width="100%" height="100%" fill="white"/>' in plain
    axis = MagicMock()
    style.in_units(axis, 1000.0)
    assert axis.set_major_formatter.call_args.args[0](-1500.0, 0) == "−1.5"


def test_nothing_straight_and_nothing_seen_make_no_figure() -> None:
    assert shown("a", 30.0, 30.0).straight
    assert quality.scale_check([shown("a", 30.0, 30.0)]) is None
