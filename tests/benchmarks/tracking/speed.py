"""End-to-end speed over decoding alone and over the usual OpenCV pipeline."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import av
import numpy as np

from tests.benchmarks.tracking.clips import clip, lengthen
from tests.benchmarks.tracking.peers import hsv_centroid, ours


def decode(path: Path) -> int:
    """Merely decode, with all threads."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        return sum(1 for _ in container.decode(stream))


def speed() -> None:
    """End-to-end speed over decoding alone and over the usual OpenCV pipeline; medians of alternating runs."""
    print(f"\n{'':>22} {'decode /s':>10} {'track /s':>9} {'OpenCV /s':>10} {'track/decode':>13} {'track/OpenCV':>13}")
    for size, scale, repeat in (((640, 480), 16.0, 8), ((1920, 1080), 40.0, 2)):
        for codec in ("libx264", "mjpeg"):
            with tempfile.TemporaryDirectory() as folder:
                short, _ = clip(Path(folder), size, codec, scale, 120, back=True)
                path = lengthen(short, repeat)
                pictures = decode(path)
                tasks = {"decode": decode, "track": ours, "opencv": hsv_centroid}
                seconds: dict[str, list[float]] = {name: [] for name in tasks}
                ours(path)
                for _ in range(5):
                    for name, task in tasks.items():
                        began = time.perf_counter()
                        task(path)
                        seconds[name].append(time.perf_counter() - began)
                best = {name: pictures / np.median(values) for name, values in seconds.items()}
                print(
                    f"{codec + ' ' + str(size[0]) + '×' + str(size[1]):>22} {best['decode']:10.0f} {best['track']:9.0f}"
                    f" {best['opencv']:10.0f} {best['track'] / best['decode']:13.2f}"
                    f" {best['track'] / best['opencv']:13.2f}"
                )
