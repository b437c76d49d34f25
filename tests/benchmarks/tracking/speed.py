"""End-to-end speed, file to marks CSV, over decoding alone and over the usual OpenCV pipeline.

Beside the time that passes stands the processor time of all threads: where the machine has other work, only that tells.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import av
import numpy as np

from evaluator.marks import write_marks
from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.benchmarks.tracking.clips import clip, lengthen
from tests.benchmarks.tracking.peers import hsv_centroid


def decode(path: Path) -> int:
    """Merely decode, with all threads."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        return sum(1 for _ in container.decode(stream))


def to_csv(path: Path) -> None:
    """Track, and write the marks as `turnscope track` does."""
    write_marks(track(open_recording(path)), path.with_suffix(".csv"))


def speed() -> None:
    """End-to-end speed over decoding alone and over the usual OpenCV pipeline; medians of alternating runs."""
    print(f"\nload of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(
        f"{'':>22} {'decode /s':>10} {'track /s':>9} {'OpenCV /s':>10} {'track/decode':>13} {'of processor':>13}"
        f" {'track/OpenCV':>13}"
    )
    for size, scale, repeat in (((640, 480), 16.0, 8), ((1920, 1080), 40.0, 2)):
        for codec in ("libx264", "mjpeg"):
            with tempfile.TemporaryDirectory() as folder:
                short, _ = clip(Path(folder), size, codec, scale, 120, back=True)
                path = lengthen(short, repeat)
                pictures = decode(path)
                tasks = {"decode": decode, "track": to_csv, "opencv": hsv_centroid}
                passed: dict[str, list[float]] = {name: [] for name in tasks}
                worked: dict[str, list[float]] = {name: [] for name in tasks}
                to_csv(path)
                for _ in range(5):
                    for name, task in tasks.items():
                        began, busy = time.perf_counter(), time.process_time()
                        task(path)
                        passed[name].append(time.perf_counter() - began)
                        worked[name].append(time.process_time() - busy)
                rate = {name: pictures / float(np.median(values)) for name, values in passed.items()}
                work = {name: float(np.median(values)) for name, values in worked.items()}
                print(
                    f"{codec + ' ' + str(size[0]) + '×' + str(size[1]):>22} {rate['decode']:10.0f} {rate['track']:9.0f}"
                    f" {rate['opencv']:10.0f} {rate['track'] / rate['decode']:13.2f}"
                    f" {work['decode'] / work['track']:13.2f} {rate['track'] / rate['opencv']:13.2f}"
                )
