"""Groups of H.264 frames that can be decoded independently: no frame refers to one before its IDR frame.

Decoders that process groups in turn need not exchange frames, whereas FFmpeg's frame threads exchange every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SLICE, IDR_SLICE, KIND = 1, 5, 31  # types of NAL units of frames, and mask of the type (ITU-T H.264, 7.3.1, table 7-1)
AVC_CONFIGURATION = 1  # first byte of extradata if units are preceded by their length (ISO/IEC 14496-15)
LONGEST = 300  # frames of a group: encoders use 250 at most by default


@dataclass(frozen=True)
class Groups:
    """Detection of the begin of groups; length_bytes: size of the length field before each NAL unit."""

    length_bytes: int

    def begins(self, packet: Any) -> bool:
        """Whether a packet contains an IDR frame; other key frames may start open groups."""
        if not packet.is_keyframe:
            return False
        data, place = memoryview(packet), 0
        while place + self.length_bytes < len(data):
            unit = place + self.length_bytes
            if data[unit] & KIND in {SLICE, IDR_SLICE}:
                return bool(data[unit] & KIND == IDR_SLICE)
            place = unit + int.from_bytes(data[place:unit], "big")
        return False

    def several(self, packets: Sequence[Any]) -> bool:
        """Whether a second group begins among the first packets of a recording."""
        return any(self.begins(packet) for packet in packets[1:])


def groups_of(stream: Any) -> Groups | None:
    """Detection of the groups of a stream; None for other codecs and for NAL units without length fields."""
    context = stream.codec_context
    tables = bytes(context.extradata or b"")
    if context.codec.name != "h264" or len(tables) < 5 or tables[0] != AVC_CONFIGURATION:
        return None
    return Groups((tables[4] & 3) + 1)
