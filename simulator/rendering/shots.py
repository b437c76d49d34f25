"""Exposure and presentation time of each image: frame rate, lost and repeated frames, jitter, fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from simulator.errors import SimulationError
from simulator.rendering.scene import Scene

TICKS = 90_000  # per second: the clock that jittered times are rounded to, as in broadcast streams
Rows = Literal["all", "even", "odd"]


@dataclass(frozen=True)
class Shot:
    """One exposure: rows of one frame of the file.

    frame: index in the file; rows: of the image that it fills ("even": 0, 2, 4, …); time_s: middle of the exposure;
    shown_s: presentation time of the frame; seed: of its noise (equal for a frame written twice).
    """

    frame: int
    rows: Rows
    time_s: Fraction
    shown_s: Fraction
    seed: int


def shots(scene: Scene, rng: np.random.Generator, clock_factor: Fraction = Fraction(1)) -> list[Shot]:
    """Plan the exposures of a scene, in time order; frame k is exposed about k / frame_rate.

    clock_factor: presentation times over true times, 1 for a correct clock of the recorder. Raises SimulationError if
    timing names frames that the scene does not have.
    """
    rate, timing = scene.frame_rate, scene.timing
    slots = max(round(scene.duration_s * rate), 1)
    late = [index for index in (*timing.dropped, *timing.repeated) if index >= slots]
    if late:
        raise SimulationError(f"timing names frame {late[0]}, but the scene has frames 0 to {slots - 1} only")
    times = [Fraction(slot) / rate for slot in range(slots)]
    if timing.jitter_s > 0:
        reach = float(2 / (5 * rate))  # two neighbours stay a fifth of a frame apart
        shifts = np.clip(rng.normal(0, timing.jitter_s, slots), -reach, reach)
        shifts[0] = abs(shifts[0])
        times = [time + Fraction(round(shift * TICKS), TICKS) for time, shift in zip(times, shifts, strict=True)]
    plan: list[Shot] = []
    frame = 0
    for slot, shown in enumerate(times):
        if slot in timing.dropped:
            continue
        source = slot - 1 if slot in timing.repeated else slot
        plan.extend(
            Shot(frame, rows, times[source] + delay, _ticked(shown, clock_factor), 2 * source + index)
            for index, (rows, delay) in enumerate(_fields(scene))
        )
        frame += 1
    return plan


def clock_of(plan: Sequence[Shot], frame_rate: Fraction) -> Fraction:
    """The longest tick that holds every presentation time exactly: a frame where possible."""
    regular = all((shot.shown_s * frame_rate).denominator == 1 for shot in plan)
    return 1 / frame_rate if regular else Fraction(1, TICKS)


def _ticked(time: Fraction, factor: Fraction) -> Fraction:
    """A time on a clock with this rate, rounded to its ticks; unchanged for factor 1."""
    return time if factor == 1 else Fraction(round(time * factor * TICKS), TICKS)


def _fields(scene: Scene) -> list[tuple[Rows, Fraction]]:
    """Rows and delay of the exposures within a frame."""
    half = 1 / (2 * scene.frame_rate)
    if scene.timing.interlaced == "top_first":
        return [("even", Fraction(0)), ("odd", half)]
    if scene.timing.interlaced == "bottom_first":
        return [("odd", Fraction(0)), ("even", half)]
    return [("all", Fraction(0))]
