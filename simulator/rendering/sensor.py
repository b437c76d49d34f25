"""Sensor: expected light → digital numbers with photon noise, read noise and quantisation.

Light is a share of full scale. The noise of a pixel depends on the seed, the frame and the pixel alone, so frames may
be drawn in any order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from simulator.compilation import compiled
from simulator.rendering.tables import Sensor

# Normal quantiles at the midpoints of 65,536 equal shares: the table for 16-bit random numbers (±4.2 sigma).
NORMAL = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)
LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)  # response of a grey sensor to red, green and blue


@compiled()
def _scrambled(state: np.uint64) -> np.uint64:
    """One output of SplitMix64 (Steele, Lea and Flood 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@compiled(fastmath=True)
def expose(
    light: NDArray[np.float32],
    level: float,
    black: float,
    full_well_e: float,
    read_noise_e: float,
    top: int,
    key: int,
    normal: NDArray[np.float32],
    out: NDArray[np.uint16],
) -> None:
    """Turn light into digital numbers.

    light: any shape, share of full scale at level 1; level: factor on light; black: black level as a share of full
    scale; full_well_e: electrons at full scale (0: no noise); top: highest number (255 for 8 bits); key: of this
    frame's noise; normal: NORMAL; out: the shape of light, uint8 or uint16.
    """
    flat, numbers = light.reshape(-1), out.reshape(-1)
    photon = np.float32(1 / full_well_e if full_well_e > 0 else 0.0)
    read = np.float32((read_noise_e / full_well_e) ** 2 if full_well_e > 0 else 0.0)
    factor, offset, scale = np.float32(level), np.float32(black), np.float32(top)
    state, step = np.uint64(key), np.uint64(0x9E3779B97F4A7C15)
    state = _scrambled(state * step + step)
    bits = np.uint64(0)
    for k in range(flat.size):
        if k & 3 == 0:
            state += step
            bits = _scrambled(state)
        value = flat[k] * factor
        value += np.sqrt(max(value, np.float32(0)) * photon + read) * normal[bits & np.uint64(0xFFFF)]
        bits >>= np.uint64(16)
        number = (value + offset) * scale + np.float32(0.5)
        numbers[k] = np.uint16(min(max(number, np.float32(0)), scale))


def digitised(
    light: NDArray[np.float32], sensor: Sensor, *, level: float = 1.0, key: int = 0
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Numbers that the sensor gives for light (h, w, 3), a share of full scale; (h, w) from a grey sensor.

    key: of the noise; equal keys give equal noise. Above 8 bits the numbers are uint16 and fill the low bits.
    """
    if not sensor.color:
        light = np.ascontiguousarray(light @ LUMA)
    out = np.empty(light.shape, dtype=np.uint8 if sensor.bits == 8 else np.uint16)
    top = 2**sensor.bits - 1
    expose(light, level, sensor.black_level, sensor.full_well_e, sensor.read_noise_e, top, key, NORMAL, out)
    return out
