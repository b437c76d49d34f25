"""Memory layout of the planes of decoded frames, determined once for all frames of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import Any, Self

import numpy as np

from evaluator.recording.frame import Frame, Plane

# Planar formats whose planes are used without conversion: names without the depth suffix.
PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "yuv440p", "yuv411p", "yuv410p")
KINDS = {1: "I", 2: "P", 3: "B"}
# Codecs whose standards put the samples of colour at the even columns of the luma if a stream does not say where: H.264
# and HEVC (annex E, chroma_sample_loc_type), MPEG-2 and MPEG-4 visual. Cameras follow them; programs that convert RGB
# (OpenCV, FFmpeg's scaler) write samples that lie midway.
COSITED = ("h264", "hevc", "mpeg2video", "mpeg4")
BY_CAMERAS = ("h264", "hevc")  # today: MPEG-2 and MPEG-4 visual are mostly written by programs
PROGRAM = (b"x264", b"x265")  # encoders that name themselves in the first frame of a stream


@dataclass(frozen=True)
class Layout:
    """Memory layout common to all frames of a recording.

    name, width, height: of the decoder's frames. target: format of a necessary conversion, if any. depth: bits of a
    sample after that. shapes: of its planes, (rows, columns). cosited: as in `Frame`.
    """

    name: str
    width: int
    height: int
    target: str | None
    depth: int
    full_range: bool
    matrix: str
    shapes: tuple[tuple[int, int], ...]
    cosited: bool | None = False

    @classmethod
    def of(cls, image: Any, codec: str = "") -> Self:
        """The layout of a decoded frame; codec: as FFmpeg names it."""
        name = image.format.name
        depth = image.format.components[0].bits
        base = name.split("p1")[0] + "p" if depth > 8 else name
        grey = name.startswith(("gray", "mono"))
        target = None
        if not (base in PLANAR or (grey and depth in (8, 10, 12, 16))) or name.endswith("be"):
            # RGB, palettes, packed and big-endian formats: full range without subsampling, so that no data is lost.
            target = ("gray16le" if depth > 8 else "gray") if grey else ("yuv444p16le" if depth > 8 else "yuvj444p")
            depth = 16 if depth > 8 else 8
        full = target is not None or grey or name.startswith("yuvj") or image.color_range == 2
        matrix = "bt709" if image.colorspace == 1 and target is None else "bt601"
        planes = (image if target is None else image.reformat(format=target)).planes
        shapes = tuple((plane.height, plane.width) for plane in planes)
        cosited = _cosited(image, codec) if target is None else False
        return cls(name, image.width, image.height, target, depth, full, matrix, shapes, cosited)

    def fits(self, image: Any) -> bool:
        """Whether a frame has this layout."""
        return bool(image.width == self.width and image.height == self.height and image.format.name == self.name)

    def frame(self, image: Any, index: int, ticks: int, tick: Fraction, before: Frame | None) -> Frame:
        """A frame with views of its planes, without copies if the format allows and no row is padded.

        before: the preceding frame, to detect a repeated one.
        """
        kind = KINDS.get(image.pict_type, "")
        if self.target is not None:
            image = image.reformat(format=self.target, dst_color_range="JPEG")
        planes = [self._view(plane, shape) for plane, shape in zip(image.planes, self.shapes, strict=True)]
        u, v = (planes[1], planes[2]) if len(planes) >= 3 else (None, None)
        repeated = before is not None and _same(before.luma, planes[0])
        return Frame(
            index, ticks, tick, planes[0], u, v, self.depth, self.full_range, self.matrix, 0, 1, kind, repeated, image,
            self.cosited,
        )  # fmt: skip

    def _view(self, plane: Any, shape: tuple[int, int]) -> Plane:
        kind, size = (np.uint16, 2) if self.depth > 8 else (np.uint8, 1)
        # Kernels are compiled for contiguous planes; copying a padded plane takes less time than compiling for it.
        return np.ascontiguousarray(np.ndarray(shape, kind, plane, 0, (plane.line_size, size)))


def _cosited(image: Any, codec: str) -> bool | None:
    """Whether the samples of colour lie at the even columns of the luma; as in `Frame`."""
    if codec not in COSITED:
        return False
    said = (bytes(part) for part in image.side_data if part.type.name == "SEI_UNREGISTERED")
    by_program = any(name in text for text in said for name in PROGRAM)
    return None if by_program or codec not in BY_CAMERAS else True


def _same(one: Plane, other: Plane) -> bool:
    """Whether two frames are equal; compares few rows first, in which nearly all different frames differ."""
    if one.shape != other.shape:
        return False
    quarter = max(len(one) // 4, 1)
    for row in chain(range(quarter // 2, len(one), quarter), range(18, len(one), 37)):
        if one[row].tobytes() != other[row].tobytes():
            return False
    return bool(np.array_equal(one, other))
