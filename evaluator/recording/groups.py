"""Groups of H.264 frames that can be decoded independently: no frame refers to one before its IDR frame.

Decoders that take groups in turn need not hand frames to one another, as FFmpeg's frame threads do for every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SLICE, IDR_SLICE, KIND = 1, 5, 31  # NAL units of a frame, and the bits that say so (ITU-T H.264, 7.3.1 and table 7-1)
AVC_CONFIGURATION = 1  # first of extradata where units are told by their length, tables lie apart (ISO/IEC 14496-15)
LONGEST = 300  # frames of a group: encoders make 250 at most unless told


@dataclass(frozen=True)
class Groups:
    """How to tell where a group begins; length_bytes: of the number before each NAL unit."""

    length_bytes: int

    def begins(self, packet: Any) -> bool:
        """Whether a packet holds an IDR frame: of those called key frames, some only start open groups."""
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
    """How to tell groups of a stream apart; None of other codecs, and where NAL units do not tell their length."""
    context = stream.codec_context
    tables = bytes(context.extradata or b"")
    if context.codec.name != "h264" or len(tables) < 5 or tables[0] != AVC_CONFIGURATION:
        return None
    return Groups((tables[4] & 3) + 1)
