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

TURNS = 9
# One quantiser for all (QP) codes the noise of the sensor, too: such images decode about as fast as those of cameras
# (3000 a second at 640 × 480). By felt quality (CRF) x264 leaves the noise out, and there is next to nothing to decode.
CLIPS = (
    ("H.264 QP 18", (640, 480), 16.0, "libx264", "qp", 4),
    ("H.264 CRF 18", (640, 480), 16.0, "libx264", "crf", 8),
    ("Motion JPEG", (640, 480), 16.0, "mjpeg", "", 8),
    ("H.264 QP 18", (1920, 1080), 40.0, "libx264", "qp", 1),
    ("H.264 CRF 18", (1920, 1080), 40.0, "libx264", "crf", 2),
    ("Motion JPEG", (1920, 1080), 40.0, "mjpeg", "", 2),
)


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
        f"{'':>24} {'decode /s':>10} {'track /s':>9} {'OpenCV /s':>10} {'track/decode':>13} {'of processor':>13}"
        f" {'track/OpenCV':>13}"
    )
    for kind, size, scale, codec, quality, repeat in CLIPS:
        with tempfile.TemporaryDirectory() as folder:
            short, _ = clip(Path(folder), size, codec, scale, 120, back=True, rate=quality)
            path = lengthen(short, repeat)
            images = decode(path)
            tasks = {"decode": decode, "track": to_csv, "opencv": hsv_centroid}
            passed: dict[str, list[float]] = {name: [] for name in tasks}
            worked: dict[str, list[float]] = {name: [] for name in tasks}
            to_csv(path)
            for _ in range(TURNS):
                for name, task in tasks.items():
                    began, busy = time.perf_counter(), time.process_time()
                    task(path)
                    passed[name].append(time.perf_counter() - began)
                    worked[name].append(time.process_time() - busy)
        rate = {name: images / float(np.median(values)) for name, values in passed.items()}
        work = {name: float(np.median(values)) for name, values in worked.items()}
        print(
            f"{f'{kind} {size[0]}×{size[1]}':>24} {rate['decode']:10.0f} {rate['track']:9.0f}"
            f" {rate['opencv']:10.0f} {rate['track'] / rate['decode']:13.2f}"
            f" {work['decode'] / work['track']:13.2f} {rate['track'] / rate['opencv']:13.2f}",
            flush=True,
        )
