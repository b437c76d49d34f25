"""Accuracy on the sample recordings, against their truth: `python tests/benchmarks/sample_accuracy.py`.

Calibrates from the gauge images and analyses the clips with the command line, as a user does, in a temporary folder;
then, and only then, reads the truth files. The true radius is path length over heading turned from 1 s after the start
command on, when the transient of some 10 ms is long over.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

SAMPLES = Path(__file__).parents[2] / "sample_videos"


def main() -> None:
    """Print errors of centre, heading and radius per run, and the worst of each."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path in SAMPLES.glob("*.*"):
            shutil.copy(path, folder)
        gauges = [str(path) for path in sorted(folder.glob("gauge-*.png"))]
        _turnscope("calibrate", *gauges, "--gauge", str(folder / "gauge.toml"), "-o", str(folder / "camera.json"))
        _turnscope("analyze", str(folder / "experiment.toml"), "-o", str(folder / "out"))
        rows = [_errors(folder / "out", row) for _, row in pd.read_csv(folder / "out" / "turning.csv").iterrows()]
    table = pd.DataFrame(rows).set_index("run")
    print(table.round(4).to_string())
    print(
        f"worst: centre {table['centre_rms_um'].max():.2f} µm RMS, heading {table['heading_rms_deg'].max():.3f}° RMS, "
        f"radius {table['radius_error_percent'].abs().max():.3f} %"
    )


def _turnscope(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "evaluator", *arguments], check=True)


def _errors(out: Path, row: pd.Series) -> dict[str, object]:
    run = str(row["run"])
    truth = pd.read_csv(SAMPLES / "truth" / f"{run}.csv")
    poses = pd.read_csv(out / "poses" / f"{run}.csv")
    both = pd.merge_asof(poses, truth, on="time_s", suffixes=("", "_true"), direction="nearest", tolerance=1e-4)
    off = np.hypot(both["x_mm"] - both["x_mm_true"], both["y_mm"] - both["y_mm_true"])
    turned = (both["heading_deg"] - both["heading_deg_true"] + 180) % 360 - 180
    steady = truth[truth["time_s"] > 1.5]
    heading = np.unwrap(np.radians(steady["heading_deg"]))
    angle = abs(heading[-1] - heading[0])
    length = np.hypot(np.diff(steady["x_mm"]), np.diff(steady["y_mm"])).sum()
    radius = length / angle if angle > np.radians(5) else np.nan  # a straight run has no radius to compare
    return {
        "run": run,
        "centre_rms_um": 1e3 * float(np.sqrt(np.mean(off**2))),
        "heading_rms_deg": float(np.sqrt(np.mean(turned**2))),
        "true_radius_mm": radius,
        "radius_mm": row["radius_mm"],
        "radius_error_percent": 100 * (row["radius_mm"] / radius - 1),
        "interval_holds": bool(row["radius_low_mm"] <= radius <= row["radius_high_mm"]) if angle > 0.1 else "",
    }


if __name__ == "__main__":
    main()
