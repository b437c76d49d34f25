"""Decoding in parallel with the processing of frames, so that FFmpeg's threads never wait for it.

Codecs with independent frames (Motion JPEG), for which FFmpeg uses one core, are decoded on all cores. Small frames of
H.264, for which FFmpeg's threads cost more than they gain, are decoded in groups on two cores.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, cycle, islice
from queue import SimpleQueue
from threading import Thread
from typing import Any

import av
from av.codec.codec import Capabilities

from evaluator.recording.groups import LONGEST, Groups, groups_of

END = object()  # end of a group: the decoder returns delayed frames, and starts again
Decoded = Callable[[], list[Any]]  # returns the frames of a packet, or raises the error of decoding it

THREADED = int(Capabilities.frame_threads | Capabilities.slice_threads)
MOST = 6  # decoders: more are not faster than a tracker, and each holds two frames
AHEAD = 2  # packets that a decoder gets before the first result is requested
# Frames decoded ahead by a single decoder, whose threads share its packets. With none, the threads wait during the
# tracking of a frame: 210 µs of decoding on two cores and 100 µs of tracking then take 290 instead of 250 µs. Too many
# frames exceed the processor's caches: of 1920 × 1080, 6 instead of 2 take 100 to 170 µs more per frame, while 4 take
# 25 µs less (measured twice, in 9 and in 16 rounds).
MOST_AHEAD, AHEAD_BYTES = 6, 12_500_000
# FFmpeg uses one thread more than there are cores. On two cores, which it shares with the tracker, as many threads as
# cores are faster (H.264, file to marks: 6 % at 1920 × 1080, 8 % at 1280 × 720, 2 to 12 % at 640 × 480).
FEW_CORES = 2
# FFmpeg's exchange of a frame between threads takes about 70 µs. For small frames, two decoders that process groups in
# turn avoid it: file to marks is faster by 15 to 33 % at 640 × 480, 22 % at 800 × 600, 1 % at 1024 × 768, and slower
# beyond, because a group waits in memory.
GROUP_DECODERS, SMALL_PX, GROUPS_AHEAD_BYTES = 2, 1024 * 768, 100_000_000


def groups_for(stream: Any, threads: int) -> Groups | None:
    """Detection of groups for several decoders, None if groups are not used. threads: 0 for any number."""
    context = stream.codec_context
    return groups_of(stream) if threads != 1 and context.width * context.height <= SMALL_PX else None


def decoders_for(stream: Any, threads: int, groups: Groups | None) -> int:
    """Number of decoders of a stream; 1 if FFmpeg's threads are as fast. threads: 0 for one per core."""
    codec = stream.codec_context.codec
    if groups is not None:
        return GROUP_DECODERS
    if not codec.intra_only or codec.capabilities & THREADED or codec.name == "rawvideo":
        return 1
    return min(threads or os.cpu_count() or 1, MOST)


def threads_for(stream: Any, threads: int, groups: Groups | None) -> int:
    """Number of threads of a decoder, 0 for FFmpeg's default. threads: requested number, 0 for any."""
    cores = os.cpu_count() or 1
    if groups is not None:
        return 1
    return threads if threads or cores > FEW_CORES or stream.codec_context.codec.name != "h264" else cores


def decoded(
    packets: Iterable[Any], streams: list[Any], *, at_once: bool, groups: Groups | None = None
) -> Iterator[Decoded]:
    """Decode packets in order, in parallel with the processing of earlier ones.

    streams: the same stream of a file that is opened once for each decoder. at_once: whether a single decoder decodes
    packets on request, without a thread. groups: distributed to the decoders in turn; None for independent packets.
    Raises errors of reading, after all packets that were read before.
    """
    if len(streams) == 1 and at_once:
        for packet in packets:
            yield packet.decode
        return
    decoders = [_Decoder(stream.codec_context) for stream in streams]
    ahead = _ahead(streams[0].codec_context, len(decoders), groups)
    waiting, failure = deque[_Decoder](), None
    try:
        try:
            for decoder in _handed_out(packets, decoders) if groups is None else _dealt(packets, decoders, groups):
                waiting.append(decoder)
                if len(waiting) == ahead:
                    yield waiting.popleft().get
        except (av.error.FFmpegError, OSError) as error:
            failure = error
        while waiting:
            yield waiting.popleft().get
        if failure is not None:
            raise failure
    finally:
        for decoder in decoders:
            decoder.stop()


def first_packets(packets: Iterator[Any], count: int) -> tuple[list[Any], Iterator[Any]]:
    """The first packets, and an iterator over all; errors of reading are raised after packets that were read before."""
    first = list[Any]()
    try:
        first.extend(islice(packets, count))
    except (av.error.FFmpegError, OSError) as error:
        packets = _raising(error)
    return first, chain(first, packets)


def _raising(error: Exception) -> Iterator[Any]:
    raise error
    yield


def _ahead(context: Any, decoders: int, groups: Groups | None) -> int:
    """Number of packets that are submitted before the first result is requested."""
    size: int = max(context.width * context.height * 3 // 2, 1)  # of a typical recording: 8 bits, 4:2:0
    if groups is not None:
        return min(LONGEST, GROUPS_AHEAD_BYTES // size)
    if decoders > 1:
        return AHEAD * decoders
    return max(AHEAD, min(MOST_AHEAD, AHEAD_BYTES // size))


def _handed_out(packets: Iterable[Any], decoders: list[_Decoder]) -> Iterator[_Decoder]:
    """Submit packets to the decoders in turn; yield the decoder of each."""
    turns = cycle(decoders)
    for count, packet in enumerate(packets):
        if not packet.size and len(decoders) > 1:  # the end: these codecs have no delayed frames
            continue
        if count == 0:  # tables that are only in the first frame are needed for all others
            for decoder in decoders[1:]:
                decoder.prime(packet)
        decoder = next(turns)
        decoder.put(packet)
        yield decoder


def _dealt(packets: Iterable[Any], decoders: list[_Decoder], groups: Groups) -> Iterator[_Decoder]:
    """Submit groups to the decoders in turn; yield the decoder of each packet, and of delayed frames of each group."""
    turns = cycle(decoders)
    decoder = next(turns)
    for count, packet in enumerate(packets):
        if count and groups.begins(packet):
            decoder.put(END)
            yield decoder
            decoder = next(turns)
        decoder.put(packet)
        yield decoder


class _Decoder:
    """A decoder in a thread, which converts packets to frames, or errors, in order."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._packets, self._results = SimpleQueue[Any](), SimpleQueue[Any]()
        self._stopped = False
        self._thread = Thread(target=self._work, name="decoder", daemon=True)
        self._thread.start()

    def prime(self, packet: Any) -> None:
        """Decode a packet of another decoder, for its tables."""
        self.put(packet)
        self._results.get()

    def put(self, packet: Any) -> None:
        """Submit a packet."""
        self._packets.put(packet)

    def get(self) -> list[Any]:
        """The frames of the next packet; raises the error of decoding it."""
        result = self._results.get()
        if isinstance(result, Exception):
            raise result
        return list(result)

    def stop(self) -> None:
        """End the thread without decoding remaining packets."""
        self._stopped = True
        self._packets.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (packet := self._packets.get()) is not None and not self._stopped:
            try:
                self._results.put(self._context.decode(None if packet is END else packet))
            except Exception as error:  # noqa: BLE001 - raised by `get`
                self._results.put(error)
            if packet is END:
                self._context.flush_buffers()
