"""Several decoders give what one gives: the same frames, in the same order, of whole and damaged recordings."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import av
import pytest

from evaluator.recording import open_recording
from evaluator.recording.groups import groups_of
from evaluator.recording.parallel import first_packets
from tests.evaluator.tracking.synthetic import noise_images, write_video

CODECS = {"mjpeg": "yuvj420p", "libx264": "yuv420p"}  # many decoders at work, and one


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("damaged", [False, True])
def test_images_decoded_on_all_cores_are_the_same_in_the_same_order(
    tmp_path: Path, codec: str, *, damaged: bool
) -> None:
    video = write_video(tmp_path / "v.avi", noise_images(24), codec=codec, pixels=CODECS[codec])
    if damaged:
        content = bytearray(video.read_bytes())
        content[len(content) // 2 : len(content) // 2 + 9000] = bytes(9000)
        video.write_bytes(content)
    one, three = open_recording(video, threads=1), open_recording(video, threads=3)
    expected = [(frame.index, frame.time, frame.luma.tobytes()) for frame in one]
    assert [(frame.index, frame.time, frame.luma.tobytes()) for frame in three] == expected
    assert three.report() == one.report()
    assert (len(expected) < 24) == damaged


@pytest.mark.parametrize("codec", CODECS)
def test_a_recording_may_be_left_before_its_end(tmp_path: Path, codec: str) -> None:
    video = write_video(tmp_path / "v.avi", noise_images(24), codec=codec, pixels=CODECS[codec])
    before = threading.active_count()
    for frame in open_recording(video, threads=3):
        if frame.index == 5:
            break
    assert threading.active_count() == before


@pytest.mark.parametrize("threads", [1, 0])
def test_a_caller_with_one_thread_decodes_in_it_and_others_beside_it(tmp_path: Path, threads: int) -> None:
    before = set(threading.enumerate())
    recording = iter(open_recording(write_video(tmp_path / "v.mkv", noise_images(30)), threads=threads))
    next(recording)
    assert bool(set(threading.enumerate()) - before) == (threads == 0)
    assert len(list(recording)) == 29


@pytest.mark.parametrize("container", ["mp4", "mkv"])
@pytest.mark.parametrize("damaged", [False, True])
def test_groups_decoded_beside_each_other_give_the_images_of_one_decoder(
    tmp_path: Path, container: str, *, damaged: bool
) -> None:
    options = {"g": "7", "x264-params": "open-gop=0:scenecut=0"}
    video = write_video(
        tmp_path / f"v.{container}", noise_images(40), codec="libx264", pixels="yuv420p", options=options
    )
    if damaged:
        content = bytearray(video.read_bytes())
        content[len(content) // 2 : len(content) // 2 + 9000] = bytes(9000)
        video.write_bytes(content)
    assert len(groups_begin(video)) > 3
    one, two = open_recording(video, threads=1), open_recording(video)
    assert [sum(thread.name == "decoder" for thread in threading.enumerate()) for _ in islice(two, 2)] == [2, 2]
    expected = [(frame.index, frame.time, frame.kind, frame.luma.tobytes()) for frame in one]
    assert [(frame.index, frame.time, frame.kind, frame.luma.tobytes()) for frame in two] == expected
    assert two.report() == one.report()
    assert (len(expected) < 40) == damaged


def test_open_groups_are_not_taken_apart(tmp_path: Path) -> None:
    options = {"g": "7", "x264-params": "open-gop=1:scenecut=0:bframes=2"}
    video = write_video(tmp_path / "v.mp4", noise_images(40), codec="libx264", pixels="yuv420p", options=options)
    assert groups_begin(video) == [0]
    one, two = open_recording(video, threads=1), open_recording(video)
    assert [frame.luma.tobytes() for frame in two] == [frame.luma.tobytes() for frame in one]
    assert len(list(two)) == 40


def groups_begin(video: Path) -> list[int]:
    with av.open(str(video)) as container:
        groups = groups_of(container.streams.video[0])
        assert groups is not None
        return [k for k, packet in enumerate(container.demux(video=0)) if packet.size and groups.begins(packet)]


def test_first_packets_are_looked_at_without_loss_and_raises_what_reading_raises_in_its_place() -> None:
    def read() -> Iterator[int]:
        yield from range(3)
        raise OSError("torn off")

    for count in (0, 2, 8):
        first, packets = first_packets(read(), count)
        assert first == list(range(min(count, 3)))
        assert [next(packets) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(OSError, match="torn off"):
            next(packets)
