"""Latency from the arrival of a image to its marks.

Beside the time that passes stands the processor time of the same images: on a machine that has other work the first
is the machine's, the second the tracker's.
"""

from __future__ import annotations

import gc
import os
import tempfile
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from evaluator.recording import Frame, open_recording
from evaluator.tracking import TrackingSettings
from evaluator.tracking.following.tracker import Tracker
from tests.benchmarks.tracking.clips import clip


def live(seconds: float = 20.0) -> None:
    """Latency from the arrival of a image to its marks, at 60 frames a second of 640×480."""
    with tempfile.TemporaryDirectory() as folder:
        path, _ = clip(Path(folder), (640, 480), "mjpeg", 16.0, 120)
        frames = list(open_recording(path))
        tracker, waits, works, late = Tracker(TrackingSettings()), [], [], 0
        arrivals: list[float] = []
        busy: list[float] = []
        gc.freeze()  # what a live program does too: what is loaded by now stays, and need not be looked through
        began = time.perf_counter()

        def paced() -> Iterator[Frame]:
            nonlocal late
            for k in range(int(60 * seconds)):
                due = began + k / 60
                late += time.perf_counter() > due + 1 / 60
                while time.perf_counter() < due:
                    time.sleep(max(0.0, min(0.002, due - time.perf_counter())))
                busy.append(time.thread_time())
                arrivals.append(time.perf_counter())
                there_and_back = k % 238
                source = frames[there_and_back if there_and_back < 120 else 238 - there_and_back]
                yield Frame(k, k, Fraction(1, 60), source.luma, source.u, source.v, 8, full_range=True, matrix="bt601",
                            row_origin=0, row_step=1, kind="", repeated=False, owner=source)  # fmt: skip

        for frame, _ in tracker.run(paced()):
            waits.append(time.perf_counter() - arrivals[frame.index])
            works.append(time.thread_time() - busy[frame.index])
        print(
            f"\nlive, {seconds:g} s at 60/s, load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores:"
            f" {len(waits)} of {int(60 * seconds)} images out, {late} handed over a image late;"
            " the first 12 images wait for the marks' shape to be learnt"
        )
        print(f"{'':>24} {'median':>8} {'99 %':>8} {'99.9 %':>8} {'most':>8} {'within 8 ms':>12}")
        for name, values in (("time until the pose, ms", waits), ("processor time, ms", works)):
            wait = 1000 * np.array(values[12:])
            shares = " ".join(f"{np.quantile(wait, share):8.2f}" for share in (0.5, 0.99, 0.999, 1.0))
            print(f"{name:>24} {shares} {np.mean(wait < 8):12.3%}")
