"""One frame of a recording: views of the decoder's planes, no copies, no conversion to RGB.

Image coordinates: x right, y down, px, the centre of the top left pixel of the full frame is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.unsignedinteger]


@dataclass(slots=True)  # not frozen: one is made for every frame, and that takes four times as long then
class Frame:
    """A frame (or a field of one) as the sensor saw it, whatever rotation the file asks of viewers.

    index: counts the frames of the recording from 0. ticks, tick: presentation time in ticks of the clock,
    and the tick in s. luma: (rows, columns) of 8 or 16 bit samples; row j lies at y = row_origin + row_step·j px of the
    full frame (a field has row_step 2). u, v: the colour planes, subsampled by whole factors, or None for a grey
    recording. depth: bits of a sample. full_range: luma spans the whole of its range rather than 16/256 to 235/256 of
    it. matrix: "bt601" or "bt709". kind: "I", "P" or "B" where the codec says how it stored the frame, else "".
    repeated: equal to the frame before. owner: keeps the decoder's buffer alive. The planes are views: copy what must
    outlive the frame.
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
        """Whether the frame is grey all over, stored with colour or without: within two levels of 8 bits."""
        within, middle = 2 << (self.depth - 8), 1 << (self.depth - 1)
        return all(
            plane is None or (int(plane.min()) >= middle - within and int(plane.max()) <= middle + within)
            for plane in (self.u, self.v)
        )

    def to_rgb(self) -> NDArray[np.uint8]:
        """Convert to (height, width, 3) RGB of 8 bits; a field's lines are doubled. For frames people look at."""
        scale = 2.0 ** (self.depth - 8)
        luma = self.luma.astype(np.float32)
        if self.u is None or self.v is None:
            planes, to_rgb = [luma], np.ones((3, 1))
        else:
            kr, kb = (0.2126, 0.0722) if self.matrix == "bt709" else (0.299, 0.114)
            red, blue = 2.0 * (1.0 - kr), 2.0 * (1.0 - kb)
            green = np.array([kb * blue, kr * red]) / (1.0 - kr - kb)
            gain = 1.0 if self.full_range else 219.0 / 224.0  # of colour over luma
            planes = [luma, self._upsampled(self.u), self._upsampled(self.v)]
            to_rgb = np.array([[1.0, 0.0, red * gain], [1.0, *(-gain * green)], [1.0, blue * gain, 0.0]])
        # Black at 0, colour about its middle, all in one matrix with a constant column.
        black, white = (0.0, 255.0) if self.full_range else (16.0, 235.0)
        zero = scale * np.array([black, 128.0, 128.0])[: len(planes)]
        to_rgb = to_rgb * 255.0 / ((white - black) * scale)
        rgb = cv2.transform(cv2.merge(planes), np.column_stack([to_rgb, -to_rgb @ zero]))
        image = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
        return np.repeat(image, self.row_step, axis=0) if self.row_step > 1 else image

    def _upsampled(self, plane: Plane) -> NDArray[np.float32]:
        rows, columns = self.luma.shape
        across, down = -(-columns // plane.shape[1]), -(-rows // plane.shape[0])
        values = plane.astype(np.float32)
        if across > 1 or down > 1:
            values = np.repeat(np.repeat(values, down, axis=0), across, axis=1)[:rows, :columns]
        return values
