"""Frames a CPU second: drawing, drawing and encoding; gauge images; marks by supersampling in NumPy.

Run: python -m tests.benchmarks.render_speed
"""

from __future__ import annotations

import tempfile
import time
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from calibration.camera import camera_above
from calibration.gauge.geometry import Gauge
from simulator.rendering import Scene, render_clip, render_frames, render_gauge_image
from tests.simulator.rendering.test_coverage import brute_force


def scene(size_px: tuple[int, int], focal_px: float, codec: str, duration_s: float) -> Scene:
    """A turn at 16 px/mm or 48 px/mm."""
    content: dict[str, Any] = {"format": 1, "seed": 1, "duration_s": duration_s, "encoding": {"codec": codec}}
    content["camera"] = {"size_px": size_px, "focal_px": focal_px, "distance_mm": 150.0, "k1": -0.25, "tilt_deg": 2.0}
    content["motion"] = {"kind": "circle", "radius_mm": 6.0, "speed_mm_s": 2.0, "start_s": -1.0}
    return Scene.model_validate(content)


def main() -> None:
    """Print frames a second for two image sizes and three codecs, and seconds for two gauge images."""
    list(islice(render_frames(scene((640, 480), 2300, "h264", 0.1)), 2))  # compile
    for size, focal in (((640, 480), 2300.0), ((1920, 1080), 5000.0)):
        frames = render_frames(scene(size, focal, "h264", 2.0))
        next(frames)
        begin = time.process_time()
        drawn = sum(1 for _ in frames) / (time.process_time() - begin)
        print(f"{size[0]} × {size[1]}: drawn {drawn:6.1f} frames a CPU second", end="")
        for codec in ("h264", "lossless", "mjpeg"):
            with tempfile.TemporaryDirectory() as folder:
                begin = time.process_time()
                render_clip(scene(size, focal, codec, 2.0), Path(folder) / "clip.mp4")
                print(f", to {codec} {120 / (time.process_time() - begin):6.1f}", end="")
        print()
    camera = camera_above(size_px=(640, 480), focal_px=2300, distance_mm=150, k1=-0.25, tilt_deg=2)
    begin = time.process_time()
    brute_force(camera, (1.0, 2.0), 0.5, 0.8, 26)
    print(f"one mark by supersampling in NumPy: {1 / (time.process_time() - begin):.1f} marks/s")
    for size, columns, rows, focal in (((640, 480), 17, 13, 2300.0), ((2560, 2160), 90, 70, 2100.0)):
        content = {"columns": columns, "rows": rows, "pitch_mm": 2.0, "diameter_mm": 1.0}
        gauge = Gauge.model_validate({"format": 1, "name": "dots", "dots": content})
        above = camera_above(size_px=size, focal_px=focal, distance_mm=150, k1=-0.2, tilt_deg=2)
        begin = time.process_time()
        image = np.asarray(render_gauge_image(above, gauge))
        print(
            f"gauge of {columns * rows} dots, {image.shape[1]} × {image.shape[0]}: {time.process_time() - begin:.2f} s"
        )


if __name__ == "__main__":
    main()
