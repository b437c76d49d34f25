"""Decoding in parallel with the processing of frames, so that FFmpeg's threads never wait for it.

Where FFmpeg itself uses one core, for codecs whose frames stand each for itself (Motion JPEG), on all cores. Where
its threads cost more than they gain, for small frames of H.264, on two by groups of frames.
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

END = object()  # of a group: the decoder gives what it held back, and begins anew
Decoded = Callable[[], list[Any]]  # gives the frames of a packet, or raises what decoding it raised

THREADED = int(Capabilities.frame_threads | Capabilities.slice_threads)
MOST = 6  # decoders: a tracker keeps up with no more, and each holds two frames
AHEAD = 2  # packets a decoder is handed before its first is asked for
# Frames ahead where there is one decoder, whose threads share its packets. With none ahead, they stand still while a
# frame is looked at: 210 µs of decoding on two cores and 100 µs of tracking then make 290 instead of 250. More than
# the processor's caches hold beside the frames that the codec itself keeps make all slower: of 1920 × 1080, 6 instead
# of 2 by 100 to 170 µs a frame, where 4 gain 25 µs (twice measured, in 9 and in 16 turns).
MOST_AHEAD, AHEAD_BYTES = 6, 12_500_000
# FFmpeg takes a thread more than there are cores. Where the tracker wants a part of two cores, as many threads as cores
# are faster (H.264, file to marks: 6 % at 1920 × 1080, 8 % at 1280 × 720, 2 to 12 % at 640 × 480).
FEW_CORES = 2
# Of small frames each is handed from thread to thread for about 70 µs. Two decoders that take groups in turn do
# without: file to marks is faster by 15 to 33 % at 640 × 480, 22 % at 800 × 600, 1 % at 1024 × 768, and slower beyond,
# for a group waits in memory for its turn.
GROUP_DECODERS, SMALL_PX, GROUPS_AHEAD_BYTES = 2, 1024 * 768, 100_000_000


def groups_for(stream: Any, threads: int) -> Groups | None:
    """How to tell apart the groups that decoders may take in turn, None where they are not to. threads: 0 for any."""
    context = stream.codec_context
    return groups_of(stream) if threads != 1 and context.width * context.height <= SMALL_PX else None


def decoders_for(stream: Any, threads: int, groups: Groups | None) -> int:
    """How many decoders a stream can have; 1 where FFmpeg's own threads do as well. threads: 0 for one per core."""
    codec = stream.codec_context.codec
    if groups is not None:
        return GROUP_DECODERS
    if not codec.intra_only or codec.capabilities & THREADED or codec.name == "rawvideo":
        return 1
    return min(threads or os.cpu_count() or 1, MOST)


def threads_for(stream: Any, threads: int, groups: Groups | None) -> int:
    """How many threads a decoder is to have, 0 for as many as FFmpeg takes. threads: what was asked for, 0 for any."""
    cores = os.cpu_count() or 1
    if groups is not None:
        return 1
    return threads if threads or cores > FEW_CORES or stream.codec_context.codec.name != "h264" else cores


def decoded(
    packets: Iterable[Any], streams: list[Any], *, at_once: bool, groups: Groups | None = None
) -> Iterator[Decoded]:
    """Decode packets in order; what each gives may be under way while the one before is still looked at.

    streams: the same stream of as many openings of one file as there are to be decoders. at_once: with one, packets are
    decoded when they are asked for, in no thread of their own. groups: what decoders take in turn; None for packets
    that stand each for itself. Raises what reading raises, after all that was read before.
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
    """Give the first packets, and all of them; what reading raises is raised after those that were read before."""
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
    """How many packets are handed out before the first is asked for."""
    size: int = max(context.width * context.height * 3 // 2, 1)  # of most recordings: 8 bits, colour of half the width
    if groups is not None:
        return min(LONGEST, GROUPS_AHEAD_BYTES // size)
    if decoders > 1:
        return AHEAD * decoders
    return max(AHEAD, min(MOST_AHEAD, AHEAD_BYTES // size))


def _handed_out(packets: Iterable[Any], decoders: list[_Decoder]) -> Iterator[_Decoder]:
    """Hand packets to the decoders in turn; gives the one that has each."""
    turns = cycle(decoders)
    for count, packet in enumerate(packets):
        if not packet.size and len(decoders) > 1:  # the end: these codecs hold no frame back
            continue
        if count == 0:  # tables that only the first frame brings serve all that follow
            for decoder in decoders[1:]:
                decoder.prime(packet)
        decoder = next(turns)
        decoder.put(packet)
        yield decoder


def _dealt(packets: Iterable[Any], decoders: list[_Decoder], groups: Groups) -> Iterator[_Decoder]:
    """Hand groups to the decoders in turn; gives the one that has each packet, and that gives what it held back."""
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
    """One decoder in a thread of its own; packets go in and frames, or what was raised, come out in order."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._packets, self._results = SimpleQueue[Any](), SimpleQueue[Any]()
        self._stopped = False
        self._thread = Thread(target=self._work, name="decoder", daemon=True)
        self._thread.start()

    def prime(self, packet: Any) -> None:
        """Let the decoder see a packet that another one decodes."""
        self.put(packet)
        self._results.get()

    def put(self, packet: Any) -> None:
        """Hand over a packet."""
        self._packets.put(packet)

    def get(self) -> list[Any]:
        """Give the frames of the next packet; raises what decoding it raised."""
        result = self._results.get()
        if isinstance(result, Exception):
            raise result
        return list(result)

    def stop(self) -> None:
        """End the thread; packets not yet decoded are left."""
        self._stopped = True
        self._packets.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (packet := self._packets.get()) is not None and not self._stopped:
            try:
                self._results.put(self._context.decode(None if packet is END else packet))
            except Exception as error:  # noqa: BLE001 - `get` raises it where it is waited for
                self._results.put(error)
            if packet is END:
                self._context.flush_buffers()
