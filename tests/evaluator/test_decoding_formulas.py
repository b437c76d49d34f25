"""Who decodes what, and how far ahead: decided from codec, size and cores, without a recording."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.recording import parallel
from evaluator.recording.groups import LONGEST, Groups
from evaluator.recording.parallel import (
    THREADED,
    _ahead,
    _dealt,
    _handed_out,
    decoded,
    decoders_for,
    groups_for,
    threads_for,
)

GROUPS = Groups(4)
AVC = bytes([1, 100, 0, 40, 0xFF])  # NAL units that tell their length in four bytes


def stream(name: str, *, width: int = 640, height: int = 480, intra: bool = False, threaded: bool = True) -> Any:
    codec = SimpleNamespace(name=name, intra_only=intra, capabilities=THREADED if threaded else 0)
    return SimpleNamespace(codec_context=SimpleNamespace(codec=codec, width=width, height=height, extradata=AVC))


MJPEG = stream("mjpeg", intra=True, threaded=False)


@pytest.mark.parametrize(
    ("of", "threads", "groups", "count"),
    [
        (MJPEG, 0, None, 4),  # one per core
        (MJPEG, 1, None, 1),
        (MJPEG, 9, None, 6),  # a tracker keeps up with no more
        (stream("prores", intra=True), 0, None, 1),  # FFmpeg's own threads do as well
        (stream("rawvideo", intra=True, threaded=False), 0, None, 1),  # nothing to decode
        (stream("h264"), 0, None, 1),
        (stream("h264"), 0, GROUPS, 2),
    ],
)
def test_decoders_are_as_many_as_gain_time(
    of: Any, threads: int, groups: Groups | None, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    assert decoders_for(of, threads, groups) == count


@pytest.mark.parametrize(
    ("cores", "codec", "asked", "groups", "count"),
    [
        (2, "h264", 0, None, 2),  # as many as there are cores: FFmpeg would take three
        (3, "h264", 0, None, 0),  # as FFmpeg takes
        (2, "hevc", 0, None, 0),
        (2, "h264", 5, None, 5),  # as was asked for
        (8, "hevc", 5, None, 5),
        (2, "h264", 5, GROUPS, 1),  # decoders beside each other have a thread each
    ],
)
def test_threads_of_a_decoder(
    cores: int, codec: str, asked: int, groups: Groups | None, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    assert threads_for(stream(codec), asked, groups) == count


@pytest.mark.parametrize(
    ("width", "height", "threads", "taken"),
    [(1024, 768, 0, True), (1025, 768, 0, False), (1024, 768, 1, False), (1024, 768, 2, True)],
)
def test_groups_are_taken_in_turn_of_small_frames_where_there_is_more_than_one_thread(
    width: int, height: int, threads: int, *, taken: bool
) -> None:
    assert (groups_for(stream("h264", width=width, height=height), threads) is not None) == taken


@pytest.mark.parametrize(
    ("width", "height", "decoders", "groups", "packets"),
    [
        (640, 480, 1, None, 6),  # small frames: as many as ever pay
        (1920, 1080, 1, None, 4),  # 12.5 MB of 3.1 MB each
        (3840, 2160, 1, None, 2),  # never less than two
        (3840, 2160, 3, None, 6),  # two for each decoder, whatever their size
        (640, 480, 2, GROUPS, 100_000_000 // 460_800),  # 217 frames of 12 bits a pixel wait in 100 MB
        (160, 120, 2, GROUPS, LONGEST),  # never more than a group
    ],
)
def test_packets_ahead_fill_no_more_than_the_memory_meant_for_them(
    width: int, height: int, decoders: int, groups: Groups | None, packets: int
) -> None:
    assert _ahead(stream("h264", width=width, height=height).codec_context, decoders, groups) == packets


class Noted:
    """A decoder that notes what it is handed."""

    def __init__(self) -> None:
        self.packets: list[Any] = []
        self.primed: list[Any] = []

    def put(self, packet: Any) -> None:
        self.packets.append(packet)

    def prime(self, packet: Any) -> None:
        self.primed.append(packet)


def packets(*sizes: int) -> list[Any]:
    return [SimpleNamespace(size=size, number=number, is_keyframe=False) for number, size in enumerate(sizes)]


def numbers(of: list[Any]) -> list[Any]:
    return ["end" if packet is parallel.END else packet.number for packet in of]


def test_packets_go_to_the_decoders_in_turn_and_all_have_seen_the_first() -> None:
    decoders: Any = [Noted(), Noted(), Noted()]
    given = list(_handed_out(packets(9, 9, 9, 9, 0), decoders))
    assert [decoders.index(each) for each in given] == [0, 1, 2, 0]
    assert [numbers(each.packets) for each in decoders] == [[0, 3], [1], [2]]
    assert [numbers(each.primed) for each in decoders] == [[], [0], [0]]


def test_the_only_decoder_is_told_the_end() -> None:
    alone: Any = Noted()
    assert len(list(_handed_out(packets(9, 9, 0), [alone]))) == 3
    assert numbers(alone.packets) == [0, 1, 2]


def test_a_group_goes_to_the_next_decoder_and_the_one_before_gives_what_it_held_back() -> None:
    decoders: Any = [Noted(), Noted()]
    groups: Any = SimpleNamespace(begins=lambda packet: packet.number in {0, 2, 3})
    given = list(_dealt(packets(9, 9, 9, 9, 9, 0), decoders, groups))
    assert [decoders.index(each) for each in given] == [0, 0, 0, 1, 1, 0, 0, 0]
    assert [numbers(each.packets) for each in decoders] == [[0, 1, "end", 3, 4, 5], [2, "end"]]


class Context:
    """A decoder that answers a packet with itself."""

    width, height = 640, 480

    def decode(self, packet: object) -> list[object]:
        return [packet]


@pytest.mark.parametrize(("decoders", "ahead"), [(1, 6), (2, 4), (3, 6)])
def test_so_many_packets_are_handed_out_before_the_first_is_asked_for_and_an_error_of_reading_comes_after_all(
    decoders: int, ahead: int
) -> None:
    """Two for each of several decoders; six of 12.5 MB for one."""
    read: list[object] = []

    def packets() -> Iterator[Any]:
        for number in range(9):
            read.append(number)
            yield SimpleNamespace(size=1, number=number)
        raise OSError("the disc is gone")

    streams: Any = [SimpleNamespace(codec_context=Context()) for _ in range(decoders)]
    results = decoded(packets(), streams, at_once=False)
    found = [next(results)()[0].number]
    assert len(read) == ahead
    with pytest.raises(OSError, match="the disc is gone"):
        found += [result()[0].number for result in results]
    assert len(read) == 9
