"""Marks that are no pair of coloured discs: tags, lights, three colours; rendered on a circle, against exact truth.

    python -m tests.benchmarks.tracking.kinds

A line per kind and codec: share of frames in which all marks are seen, RMS error of a coordinate in px, and RMS of the
errors over their stated standard uncertainties (1 where these are true).
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from tests.evaluator.tracking.test_kinds_of_marks import errors_px, normal_errors, rendered, robot_file, tracked

LIGHT = {"y_mm": 0.0, "diameter_mm": 0.5, "kind": "light"}
ROBOTS = {
    "ArUco, 52 px": [{"name": "tag_7", "x_mm": 0.5, "y_mm": 0.0, "diameter_mm": 3.5, "kind": "aruco"}],
    "AprilTag, 52 px": [{"name": "tag_7", "x_mm": 0.5, "y_mm": 0.0, "diameter_mm": 3.5, "kind": "apriltag"}],
    "lights, 7 px": [{"name": "a", "x_mm": -2.0, **LIGHT}, {"name": "b", "x_mm": 2.0, **LIGHT}],
    "three colours, 15 px": [
        {"name": name, "x_mm": x, "y_mm": y}
        for name, (x, y) in {"red": (2.0, 0.0), "blue": (-1.5, 2.0), "magenta": (-1.5, -2.0)}.items()
    ],
}


def main() -> None:
    for kind, marks in ROBOTS.items():
        for codec in ("lossless", "h264"):
            with tempfile.TemporaryDirectory() as name:
                robot = robot_file(Path(name), marks)
                clip, truth = rendered(Path(name), robot, encoding={"codec": codec}, duration_s=2.0)
                table = tracked(clip, robot)
            names = [str(mark["name"]) for mark in marks]
            seen = np.all([table[f"{name}_status"] == "ok" for name in names], axis=0).mean()
            off = np.concatenate([errors_px(table, truth, name) for name in names])
            normal = np.concatenate([normal_errors(table, truth, name) for name in names])
            rms, stated = (float(np.sqrt(np.nanmean(values**2))) for values in (off, normal))
            print(f"{kind:22} {codec:9} seen {100 * seen:5.1f} %  error {rms:.4f} px  over stated {stated:.2f}")


if __name__ == "__main__":
    main()
