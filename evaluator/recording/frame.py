"""One frame of a recording: views of the decoder's planes, no copies, no conversion to RGB.

Image coordinates: x right, y down, px, the centre of the top left pixel of the full frame is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.unsignedinteger]
Sample = TypeVar("Sample", bound=np.generic)


@dataclass(slots=True)  # not frozen: one is made for every frame, and that takes four times as long then
class Frame:
    """A frame, or a field of one, as recorded by the sensor, regardless of rotation metadata for viewers.

    index: counts the frames of the recording from 0. ticks, tick: presentation time in ticks of the clock,
    and the tick in s. luma: (rows, columns) of 8 or 16 bit samples; row j lies at y = row_origin + row_step·j px of the
    full frame (a field has row_step 2). u, v: the colour planes, subsampled by whole factors, or None for a grey
    recording. depth: bits of a sample. full_range: luma spans the whole of its range rather than 16/256 to 235/256 of
    it. matrix: "bt601" or "bt709". kind: "I", "P" or "B" if the codec states how it stored the frame, else "".
    repeated: equal to the frame before. owner: keeps the decoder's buffer alive. cosited: whether the samples of u and
    v lie at the even columns of the luma, as cameras have it in H.264 and HEVC, rather than midway between two, as JPEG
    has it; None where a program wrote the file, which may do either. The planes are views: copy what must outlive the
    frame.
    """

    index: int
    ticks: int
    tick: Fraction
    luma: Plane
    u: Plane | None
    v: Plane | None
    depth: int
    full_range: bool
    matrix: str
    row_origin: int
    row_step: int
    kind: str
    repeated: bool
    owner: object
    cosited: bool | None = False

    @property
    def time(self) -> Fraction:
        """Exact presentation time in seconds."""
        return self.ticks * self.tick

    @property
    def time_s(self) -> float:
        """Presentation time in seconds, rounded once."""
        return self.ticks * self.tick.numerator / self.tick.denominator

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height) of the full frame; a field's height is doubled."""
        return self.luma.shape[1], self.luma.shape[0] * self.row_step

    @property
    def colourless(self) -> bool:
        """Whether the whole frame is grey, within two levels of 8 bits, even if stored with colour planes."""
        within, middle = 2 << (self.depth - 8), 1 << (self.depth - 1)
        return all(
            plane is None or (int(plane.min()) >= middle - within and int(plane.max()) <= middle + within)
            for plane in (self.u, self.v)
        )

    @property
    def black(self) -> float:
        """Luma of black."""
        return 0.0 if self.full_range else 16.0 * 2.0 ** (self.depth - 8)

    @property
    def rgb_from_planes(self) -> NDArray[np.float64]:
        """R, G, B in levels of 8 bits from luma, u, v and 1, (3, 4)."""
        scale = 2.0 ** (8 - self.depth)
        kr, kb = (0.2126, 0.0722) if self.matrix == "bt709" else (0.299, 0.114)
        luma, color = (1.0, 1.0) if self.full_range else (255 / 219, 255 / 224)
        red, blue = 2 * (1 - kr) * color, 2 * (1 - kb) * color
        of_color = np.array([[0.0, red], [-kb * blue / (1 - kr - kb), -kr * red / (1 - kr - kb)], [blue, 0.0]])
        constant = -luma * scale * self.black - 128.0 * of_color.sum(axis=1)
        return np.column_stack([np.full(3, luma * scale), of_color * scale, constant])

    def to_rgb(self) -> NDArray[np.uint8]:
        """Convert to (height, width, 3) RGB of 8 bits for display; the lines of a field are doubled."""
        planes, to_rgb = [self.luma.astype(np.float32)], self.rgb_from_planes
        if self.u is None or self.v is None:
            to_rgb = to_rgb[:, [0, 3]]
            to_rgb[:, 1] = -to_rgb[:, 0] * self.black  # neutral level of colour
        else:
            planes += [self.upsampled(plane).astype(np.float32) for plane in (self.u, self.v)]
        rgb = cv2.transform(cv2.merge(planes), to_rgb)
        image = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
        return np.repeat(image, self.row_step, axis=0) if self.row_step > 1 else image

    def upsampled(self, plane: NDArray[Sample]) -> NDArray[Sample]:
        """An array with a value for each pixel of a colour plane, repeated for the pixels of the luma."""
        rows, columns = self.luma.shape
        across, down = -(-columns // plane.shape[1]), -(-rows // plane.shape[0])
        if across == down == 1:
            return plane
        return np.repeat(np.repeat(plane, down, axis=0), across, axis=1)[:rows, :columns]
