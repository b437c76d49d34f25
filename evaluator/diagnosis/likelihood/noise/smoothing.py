"""Tracks that a program has smoothed or that are from a film: their frames that average over a change of the motion.

A moving average of some frames, or a polynomial through them, leaves a steady turn as it is to a part in 10,000, but
begins to move before the motors start and is late after it. Motors that follow their command with a lag of a frame and
a half do the same: a mean of five frames at 60 Hz was named command-lag with a probability above 0.999. Codecs predict
frames from those before and after, so that films begin to move too early as well, by less and over fewer frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.noise.spectrum import Spectrum

Floats = NDArray[np.float64]

# Frequencies, as shares of the frame rate, and the bands between them.
SLOWEST, FASTEST, BANDS = 0.1, 0.5, 16
FEWEST_MODES = 60  # in each band: medians of their powers scatter by a fifth
# A mean or a parabola over several frames lets nothing through at some frequencies, and something at higher ones: power
# that a higher band has over a lower one. In 17 smoothed sessions (means of 5 and 9 frames, parabolas of 7 and 9) it
# was 18 to 70; rounding to a hundredth of a millimetre and more conceals it (2.7 and less in seven others). It was 1.1
# to 2.0 in raw tracks, 1.7 in those of compressed films, whose noise is alike in neighbouring frames as well, but
# evenly, and 3.5 under vibration. Two neighbouring bands must have it: lamps that flicker, or marks that move over the
# blocks of a codec at one speed in all runs, raise a single one (5.7 times the others in a film of MJPEG).
RISES = 6.0
# Frames on either side of a change: four of a mean of nine, and a start that is known to a frame and a half.
AVERAGED_FRAMES = 6
# The same of films. In 9 clips by x264 with B frames, the last three frames at rest were ahead by up to 0.07, 0.2 and
# 0.3 of a frame's motion, and the first two in motion off by up to 0.17 of it; one frame for the start.
PREDICTED_FRAMES = 4


def is_smoothed(spectra: Sequence[Spectrum]) -> bool:
    """Whether the noise of all runs together lacks frequencies, as that of smoothed tracks does."""
    if not spectra:
        return False
    frequency = np.concatenate([item.frequency_hz * item.step_s for item in spectra])
    power = np.concatenate([item.power_mm2 for item in spectra])
    edges = np.linspace(SLOWEST, FASTEST, BANDS + 1)
    bands = [power[(low < frequency) & (frequency <= high)] for low, high in pairwise(edges)]
    if min(map(len, bands)) < FEWEST_MODES:
        return False
    levels = np.array([np.median(band) for band in bands])
    risen = levels > RISES * np.minimum.accumulate(levels)
    return bool((risen[1:] & risen[:-1]).any())


def averaged_frames(time_s: Floats, changes_s: Sequence[float], frames: int) -> NDArray[np.bool_]:
    """Frames (n,) within some frames of a change of the motion; none if that were more than half of them.

    Half of the frames are left by a dozen changes in ten seconds; a log of a controller has hundreds of small ones.
    """
    reach_s = (frames + 0.5) * float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    near = np.zeros(len(time_s), dtype=np.bool_)
    for at in changes_s:
        near |= np.abs(time_s - at) < reach_s
    return near if near.sum() <= len(near) / 2 else np.zeros_like(near)
