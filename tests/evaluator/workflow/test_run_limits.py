"""What is refused of a run, and what is remarked about it: a value from either side of every limit."""

from __future__ import annotations

from fractions import Fraction
from math import sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.recording import TimingReport
from evaluator.recording.frame import Frame
from evaluator.recording.video import Recording
from evaluator.settings import Run
from evaluator.workflow.runs.job import _notes, _spacing_notes
from evaluator.workflow.runs.stages import _refuse_cut, _refuse_unseen
from evaluator.workflow.turning_tables import Ruler, together
from evaluator.workflow.viewing.cameras import light_of

VIDEO = Path("r01.mp4")


def run(**values: Any) -> Any:
    return SimpleNamespace(**{"id": "r01", "source": VIDEO, "start_s": None, "stop_s": None, **values})


@pytest.mark.parametrize(
    ("ratio", "said"), [(1.029, ""), (0.971, ""), (1.031, "3 % farther apart"), (0.969, "3 % nearer")]
)
def test_marks_that_are_three_percent_from_where_they_should_be_are_remarked(ratio: float, said: str) -> None:
    notes = list(_notes(run(), {}, {"mark_spacing_ratio": ratio}))
    assert bool(notes) == bool(said)
    assert said in "".join(notes)


@pytest.mark.parametrize(
    ("relative", "over_stated", "said"),
    [(0.011, 2.6, True), (0.009, 2.6, False), (0.011, 2.4, False), (float("nan"), float("nan"), False)],
)
def test_marks_whose_distance_varies_more_than_they_state_are_remarked(
    relative: float, over_stated: float, *, said: bool
) -> None:
    assert ["varies by 1.1 %, 3 times" in note for note in _spacing_notes(relative, over_stated)] == [True] * said


@pytest.mark.parametrize(
    ("late", "width", "said"),
    [(0.11, 0.02, True), (-0.11, 0.02, True), (0.09, 0.02, False), (0.3, 0.098, True), (0.3, 0.102, False)],
)
def test_a_log_that_is_a_tenth_of_a_second_off_is_remarked_where_it_is_known_as_well(
    late: float, width: float, *, said: bool
) -> None:
    turning = {"late_s": late, "late_low_s": late - width / 2, "late_high_s": late + width / 2}
    assert bool(list(_notes(run(), {}, turning))) == said


def test_a_delay_that_is_not_known_is_said_to_be_so_in_one_sentence() -> None:
    (note,) = _notes(run(), {}, dict.fromkeys(("late_s", "late_low_s", "late_high_s"), float("nan")))
    assert "cannot be determined" in note
    assert "start_s is taken as stated" in note


@pytest.mark.parametrize(("hidden", "said"), [(0.0, ""), (4e-4, ""), (0.04, "takes up to 0.040 s to change")])
def test_half_of_a_rise_that_would_not_show_is_said_to_be_in_the_delay(hidden: float, said: str) -> None:
    turning = {"late_s": 0.3, "late_low_s": 0.27, "late_high_s": 0.31, "hidden_rise_s": hidden}
    (note,) = _notes(run(), {}, turning)
    assert note.endswith("half of that is included" if said else "motors that wait")
    assert said in note


@pytest.mark.parametrize(("stop", "said"), [(5.09, False), (5.11, True)])
def test_a_recording_that_ends_a_tenth_of_a_second_before_the_motors_stop_is_remarked(
    stop: float, *, said: bool
) -> None:
    notes = list(_notes(run(stop_s=stop), {"last_s": 5.0, "notes": ["first"]}, {}))
    assert notes[0] == "first"
    assert (len(notes) == 2) == said


@pytest.mark.parametrize(
    ("start", "stop", "fault"),
    [
        (4.99, None, ""),
        (5.0, None, "start_s = 5 s, but r01.mp4 ends at 5.00 s"),
        (None, 1.01, ""),
        (None, 1.0, "stop_s = 1 s, but r01.mp4 begins at 1.00 s"),
    ],
)
def test_motors_start_before_the_end_of_a_recording_and_stop_after_its_beginning(
    start: float | None, stop: float | None, fault: str
) -> None:
    told: Any = SimpleNamespace(logged=False, start_s=start, stop_s=stop)
    found = Run.outside(run(start_s=start, stop_s=stop), told, 1.0, 5.0)
    assert (found or "").startswith(f"run r01: {fault}" if fault else "")
    assert bool(found) == bool(fault)
    logged: Any = SimpleNamespace(logged=True, starts_at_rest=True, start_s=start, stop_s=stop)
    by_log = Run.outside(run(start_s=start, stop_s=stop), logged, 1.0, 5.0)
    assert (by_log or "").startswith(f"run r01: commands: motors {'on' if start else 'off'} at " if fault else "")
    assert bool(by_log) == bool(fault)


def test_a_start_by_a_clock_that_counts_from_1970_lies_in_its_recording(tmp_path: Path) -> None:
    (tmp_path / "p.txt").write_text("1700000000.5 0 0 0 0 0 0 1\n1700000009.5 0 0 0 0 0 0 1\n", encoding="utf-8")
    path = str(tmp_path / "p.txt")
    for start_s, fault in ((1700000001.0, False), (1700000010.0, True)):
        by_clock = Run(id="r01", poses=path, start_s=start_s, left_rpm=1.0, right_rpm=1.0)
        assert (by_clock.outside(by_clock.run_command(), 0.5, 9.5) is not None) == fault


def report(last_s: float) -> TimingReport:
    frames, rate = round(60 * last_s) + 1, Fraction(1, 60)
    return TimingReport(frames, Fraction(0), (frames - 1) * rate, rate, (), (), variable=False, notes=())


def as_read(promised: int, promised_s: float | None = None, left_out: int = 0) -> Any:
    return SimpleNamespace(expected_frames=promised, expected_s=promised_s, left_out_frames=left_out)


@pytest.mark.parametrize(
    ("promised", "promised_s", "left_out", "cut"),
    [
        (302, None, 0, False),  # 299 are there: of 302 three are not
        (304, None, 0, True),
        (0, 5.03, 0, False),  # 302 intervals
        (0, 5.05, 0, True),
        (302, 9.0, 0, False),  # frames are counted where both are said
        (0, None, 0, False),
        (0, None, 5, False),
        (360, None, 60, False),  # a phone cut the first second away
        (360, None, 50, True),
    ],
)
def test_a_recording_of_which_a_hundredth_is_missing_at_its_end_is_refused(
    promised: int, promised_s: float | None, left_out: int, *, cut: bool
) -> None:
    there, recording = report(298 / 60), as_read(promised, promised_s, left_out)
    if cut:
        with pytest.raises(InputError, match=r"cut off after 4\.97 s"):
            _refuse_cut(recording, there, VIDEO)
    else:
        _refuse_cut(recording, there, VIDEO)


def test_a_recording_whose_frames_are_all_there_is_whole_although_most_intervals_are_longer_than_the_mean() -> None:
    """A phone that takes 24 frames a second in the dark and 30 in the light: 60 and 40 frames."""
    last = Fraction(60, 24) + Fraction(40, 30)
    there = TimingReport(101, Fraction(0), last, Fraction(1, 24), (), (), variable=True, notes=())
    _refuse_cut(as_read(101), there, VIDEO)


@pytest.mark.parametrize(
    ("green", "yellow", "marks", "refused"),
    [
        ("ok", "absent", ["green", "yellow"], "yellow"),
        ("absent", "absent", ["green"], "green"),
        ("ok", "absent", ["green"], ""),
        ("ok", "ok", ["green", "yellow"], ""),
        ("ok", "ok", ["green", "yellow", "blue"], ""),  # two of three are enough
        ("ok", "absent", ["green", "yellow", "blue"], "yellow"),
    ],
)
def test_two_marks_must_be_seen_or_the_only_one(green: str, yellow: str, marks: list[str], refused: str) -> None:
    table = pd.DataFrame({"green_status": ["absent", green], "yellow_status": ["absent", yellow]})
    if not refused:
        _refuse_unseen(table, marks, VIDEO)
        return
    with pytest.raises(InputError, match=f"the {refused} mark is in none of 2 frames"):
        _refuse_unseen(table, marks, VIDEO)


def test_a_ruler_gives_the_size_of_a_pixel_with_the_error_of_both_its_ends() -> None:
    ruler = Ruler((10.0, 20.0, 40.0, 60.0), 25.0)
    assert ruler.mm_per_px == pytest.approx(0.5)
    assert ruler.sigma == pytest.approx(sqrt(2) * 1.0 / 50.0)


@pytest.mark.parametrize(("apart", "fits"), [(1.01, True), (0.99, False)])
def test_ends_of_a_ruler_are_farther_apart_than_a_pixel(apart: float, *, fits: bool) -> None:
    ruler = Ruler((0.0, 0.0, 0.0, apart), 1.0)
    if fits:
        assert ruler.mm_per_px == pytest.approx(1 / apart)
    else:
        with pytest.raises(InputError, match="give two points"):
            assert ruler.mm_per_px


@pytest.mark.parametrize(("radius", "one"), [(10.9, True), (11.1, False)])
def test_turns_whose_radii_differ_by_more_than_a_tenth_are_no_repetitions(radius: float, *, one: bool) -> None:
    rows = [
        {
            "radius_mm": value, "radius_random_mm": 0.5, "radius_systematic_mm": 0.1, "speed_mm_s": 2.0,
            "yaw_rate_deg_s": 9.0,
        }
        for value in (10.0, radius)
    ]  # fmt: skip
    said = together(rows)
    assert said.startswith("2 repetitions: radius" if one else "not pooled as repetitions")


def said_stream(order: int) -> Any:
    """A video stream whose container says an order of fields."""
    return SimpleNamespace(codec_context=SimpleNamespace(field_order=order), disposition=0, width=8, height=8)


@pytest.mark.parametrize(("rate", "looked_at"), [(30, True), (31, True), (32, False), (None, False)])
def test_frames_are_looked_at_for_fields_up_to_thirty_one_a_second(rate: int | None, *, looked_at: bool) -> None:
    plane = np.zeros((8, 8), np.uint8)
    frames = [
        Frame(
            k, k, Fraction(1, 30), plane, None, None, 8, full_range=True, matrix="bt601", row_origin=0, row_step=1,
            kind="", repeated=False, owner=None,
        )
        for k in range(3)
    ]  # fmt: skip
    taken = []
    recording: Any = Recording.__new__(Recording)
    recording.live, recording.nominal_rate = False, None if rate is None else Fraction(rate)
    recording._opened = SimpleNamespace(streams=SimpleNamespace(video=[said_stream(0)]))

    def images() -> Any:
        for frame in frames:
            taken.append(frame.index)
            yield frame

    order, given = recording._field_order(images())
    assert order == "none"
    assert taken == ([0, 1, 2] if looked_at else [])
    assert [frame.index for frame in given] == [0, 1, 2]  # whatever was looked at before


@pytest.mark.parametrize(
    ("order", "said"), [(0, "none"), (1, "none"), (2, "top"), (3, "bottom"), (4, "bottom"), (5, "top")]
)
def test_order_of_fields_that_a_container_says(order: int, said: str) -> None:
    recording: Any = Recording.__new__(Recording)
    stream = said_stream(order)
    recording._opened = SimpleNamespace(streams=SimpleNamespace(video=[stream]))
    assert recording._said_order() == said


@pytest.mark.parametrize(("kind", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_light_of_a_gauge_image_clips_a_hundredth_at_most_and_reaches_a_quarter_of_the_range(
    kind: type[np.unsignedinteger[Any]], top: int
) -> None:
    image = np.full((100, 100, 3), top // 2, kind)
    image.reshape(-1, 3)[:100, 1] = top
    assert light_of(image) == ""
    image.reshape(-1, 3)[100, 1] = top
    assert light_of(image).startswith("1 % of the pixels are saturated")
    assert light_of(np.full((9, 9), 0.26 * top).astype(kind)) == ""
    assert light_of(np.full((9, 9), 0.24 * top).astype(kind)).startswith("the brightest pixels reach 24 % of the range")
