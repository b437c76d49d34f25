"""What a recording says of its frames, times and fields, without decoding one."""

from __future__ import annotations

from contextlib import ExitStack
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.recording import video as video_module
from evaluator.recording.video import Recording


def stream() -> Any:
    """A stream of H.264."""
    codec = SimpleNamespace(name="h264")
    context = SimpleNamespace(codec=codec, width=640, height=480, extradata=b"")
    return SimpleNamespace(codec_context=context, disposition=0, width=640, height=480)


class Played(Recording):
    """A recording whose container is not opened, and whose packets give the images that are said."""

    def __init__(self, *results: list[Any] | Exception) -> None:
        self._notes, self._threads, self.live = [], 1, False
        self.results = results

    def images(self) -> list[Any]:
        def decode(result: list[Any] | Exception) -> Any:
            def now() -> list[Any]:
                if isinstance(result, Exception):
                    raise result
                return result

            return SimpleNamespace(decode=now)

        return list(self._decoded(iter([decode(result) for result in self.results]), [None], None))

    @property
    def notes(self) -> list[str]:
        return self._notes


def image(*, corrupt: bool = False) -> Any:
    return SimpleNamespace(is_corrupt=corrupt)


def test_damaged_frames_are_left_out_and_the_first_is_named_once() -> None:
    good = [image(), image(), image()]
    played = Played([good[0], good[1]], [image(corrupt=True)], [image(corrupt=True)], [good[2]])
    assert played.images() == good
    assert played.notes == ["damaged frames are left out, the first near frame 2"]


def test_packets_that_cannot_be_decoded_are_passed_over_and_the_first_is_named_once() -> None:
    good = [image(), image()]
    played = Played([good[0]], OSError("torn: by hand"), OSError("again"), [good[1]])
    assert played.images() == good
    assert played.notes == ["damaged data near frame 1 (torn)"]


def test_whole_frames_leave_no_note() -> None:
    played = Played([image()], [image(), image()])
    assert len(played.images()) == 3
    assert played.notes == []


def test_a_stream_that_is_live_is_decoded_at_once_and_by_slices() -> None:
    video: Any = stream()
    live = Played()
    live.live, live._threads = True, 3
    container: Any = SimpleNamespace(streams=SimpleNamespace(video=[video]), demux=lambda _: iter(()))
    with ExitStack() as opened:
        first, images = live._under_way(container, opened)
    assert (first, list(images)) == ([], [])
    assert (video.thread_type, video.codec_context.thread_count) == ("SLICE", 3)


def finished(count: int, standing: int, promised: int) -> list[str]:
    """Notes of a recording after so many frames, others whose times stand, and those that its container promised."""
    played = Played()
    played.name, played._standing, played.expected_frames = "a.mp4", standing, promised
    played.tick, played.nominal_rate, played.expected_s = Fraction(1, 60), Fraction(60), None
    played._packets = None
    played._finish(count, count - 1)
    return played.notes


def test_frames_that_are_missing_are_those_that_were_neither_given_nor_left_out() -> None:
    assert finished(8, 0, 8) == finished(8, 0, 0) == []
    assert finished(7, 0, 8) == ["the file announces 8 frames but only 7 could be decoded"]
    assert finished(6, 2, 8) == ["2 frames are left out: their times are not after those before them"]
    assert len(finished(6, 1, 8)) == 2


@pytest.mark.parametrize(("standing", "refused"), [(4, False), (5, True)])
def test_a_recording_most_of_whose_times_stand_is_refused(standing: int, *, refused: bool) -> None:
    if refused:
        with pytest.raises(InputError, match="stand still or run backwards in 5 of 9 frames"):
            finished(4, standing, 0)
    else:
        assert len(finished(4, standing, 0)) == 1


def test_a_recording_without_a_frame_is_refused() -> None:
    with pytest.raises(InputError, match="no frame can be decoded"):
        finished(0, 0, 8)


@pytest.mark.parametrize(("lacking", "told"), [(9.9, False), (10.1, True)])
def test_a_recording_that_ends_more_than_ten_frames_before_its_announced_end_is_told(
    lacking: float, *, told: bool
) -> None:
    played = Played()
    played.name, played._standing, played.expected_frames, played._packets = "a.avi", 0, 0, None
    played.tick, played.nominal_rate, played.expected_s = Fraction(1, 60), Fraction(60), (99 + lacking) / 60
    played._finish(100, 99)
    said = "the file announces 1.818 s, but the last frame that could be decoded is at 1.65 s"
    assert played.notes == ([said] if told else [])


def test_frames_that_an_edit_takes_out_are_not_missing() -> None:
    played = Played()
    played.name, played._standing, played.expected_frames, played.expected_s = "a.mp4", 0, 8, None
    played.tick, played.nominal_rate, played._packets = Fraction(1, 60), Fraction(60), SimpleNamespace(discarded=2)
    played._finish(6, 5)
    assert played.notes == []
    assert played.left_out_frames == 2


@pytest.mark.parametrize(
    ("code", "order"), [(0, "none"), (1, "none"), (2, "top"), (3, "bottom"), (4, "bottom"), (5, "top")]
)
def test_the_order_of_fields_that_a_file_states_is_that_in_which_they_are_shown(code: int, order: str) -> None:
    """AVFieldOrder of FFmpeg: unknown, progressive, TT, BB, TB (top is coded first, bottom shown first), BT."""
    video: Any = stream()
    video.codec_context.field_order = code
    played = Played()
    played._opened = SimpleNamespace(streams=SimpleNamespace(video=[video]))
    assert played._said_order() == order


@pytest.mark.parametrize(
    ("rate", "said", "seen", "order"),
    [
        (30, "none", "top", "top"),
        (32, "none", "top", "none"),  # no interlaced camera is so fast
        (None, "none", "top", "none"),
        (60, "bottom", "top", "top"),  # what is seen counts more than what is stated
        (30, "bottom", None, "bottom"),
    ],
)
def test_fields_are_looked_for_in_slow_recordings_and_where_they_are_stated(
    rate: int | None, said: str, seen: str | None, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_module, "field_order", lambda frames: (list(frames), seen)[1])
    played = Played()
    played.live, played.nominal_rate = False, rate and Fraction(rate)
    monkeypatch.setattr(played, "_said_order", lambda: said)
    frames = [SimpleNamespace(luma=SimpleNamespace(nbytes=10)) for _ in range(130)]
    found, images = played._field_order(iter(frames))  # type: ignore[arg-type]
    assert found == order
    assert list(images) == frames  # none is lost by looking


def test_fields_are_looked_for_in_a_hundred_and_twenty_frames_or_a_hundred_megabytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []
    monkeypatch.setattr(video_module, "field_order", lambda frames: looked.append(len(list(frames))))
    played = Played()
    played.live, played.nominal_rate = False, Fraction(30)
    monkeypatch.setattr(played, "_said_order", lambda: "none")
    for size in (10, 30_000_000):
        frames: Any = (SimpleNamespace(luma=SimpleNamespace(nbytes=size)) for _ in range(130))
        played._field_order(frames)
    assert looked == [120, 4]


@pytest.mark.parametrize(("rate", "ticks"), [(Fraction(25), 3600), (Fraction(30000, 1001), 3003), (None, 3000)])
def test_a_frame_lasts_so_many_ticks(rate: Fraction | None, ticks: int) -> None:
    played = Played()
    played.nominal_rate, played.tick = rate, Fraction(1, 90000)
    assert played._interval_ticks() == ticks
