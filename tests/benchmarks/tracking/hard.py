"""Hard clips of the project's own renderer against their truth: identity, silent errors, gaps.

Every kind of trouble is drawn with other places, directions and speeds for every seed. A find is wrong where it lies
farther from the truth than half a mark's radius; an error is silent where it exceeds 4 of its stated sigmas along
either axis; a gap ends where the mark shows again, and is recovered within 2 images or late. Codecs are those of
cameras: H.264 at quality 18 and MJPEG.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from evaluator.recording import open_recording
from evaluator.tracking import track
from simulator.rendering import Scene, render_clip

Tables = dict[str, Any]
Trouble = Callable[[np.random.Generator], Tables]
SECONDS = 3.0
RADIUS_PX = 7.8  # of a mark: 15 px/mm and a little nearer to the camera than the plate


def _path(rng: np.random.Generator) -> list[list[float]]:
    """Two ends of a line across the middle of the image."""
    angle, x, y = rng.uniform(0, np.pi), rng.uniform(280, 360), rng.uniform(200, 280)
    return [[x - 500 * np.cos(angle), y - 500 * np.sin(angle)], [x + 500 * np.cos(angle), y + 500 * np.sin(angle)]]


def _glare(rng: np.random.Generator) -> Tables:
    spots = [(rng.uniform(220, 420), rng.uniform(140, 340), rng.uniform(8, 60)) for _ in range(3)]
    return {"glare": [{"x_px": x, "y_px": y, "radius_px": r, "strength": rng.uniform(0.3, 0.9)} for x, y, r in spots]}


def _distractors(rng: np.random.Generator) -> Tables:
    colors = ([0.16, 0.86, 0.26], [0.92, 0.82, 0.12])
    return {
        "distractor": [
            {
                "x_mm": rng.uniform(-18, 18), "y_mm": rng.uniform(-14, 14), "diameter_mm": rng.uniform(0.8, 2.5),
                "color": colors[k % 2], "velocity_mm_s": [rng.uniform(-3, 3), rng.uniform(-3, 3)],
            }
            for k in range(6)
        ]
    }  # fmt: skip


def _leaving(rng: np.random.Generator) -> Tables:
    return {"motion": _circle(rng) | {"radius_mm": 9.0, "x_mm": rng.uniform(11, 14), "speed_mm_s": 25.0}}


TROUBLES: dict[str, Trouble] = {
    "nothing": lambda _: {},
    "thin wire": lambda rng: {"wire": [{"points_px": _path(rng), "width_px": rng.uniform(1.5, 3)}]},
    "wide wire": lambda rng: {"wire": [{"points_px": _path(rng), "width_px": rng.uniform(6, 14)}]},
    "glare": _glare,
    "distractors": _distractors,
    "leaving the image": _leaving,
    "dim light": lambda rng: {"exposure": {"gain": rng.uniform(0.12, 0.25)}},
    "lights on": lambda rng: {
        "lighting": {"switched_at_s": rng.uniform(0.8, 2.0), "level_before": rng.uniform(0.2, 0.5)}
    },
    "drops, repeats": lambda rng: {
        "timing": {
            "dropped": sorted(rng.choice(np.arange(10, 170), 12, replace=False).tolist()),
            "repeated": sorted(rng.choice(np.arange(60, 170), 6, replace=False).tolist()),
        }
    },
    "top field first": lambda _: {"timing": {"interlaced": "top_first"}, "frame_rate": Fraction(30)},
    "bottom field first": lambda _: {"timing": {"interlaced": "bottom_first"}, "frame_rate": Fraction(25)},
    "motion blur": lambda rng: {"motion": _circle(rng) | {"speed_mm_s": 40.0}, "exposure": {"time_s": 0.012}},
}  # fmt: skip


def _circle(rng: np.random.Generator) -> Tables:
    return {
        "kind": "circle", "radius_mm": rng.uniform(4, 7), "speed_mm_s": rng.uniform(4, 12), "start_s": 0.5,
        "side": str(rng.choice(["left", "right"])), "heading_deg": rng.uniform(0, 360),
    }  # fmt: skip


@dataclass(frozen=True)
class Tally:
    """Of one clip: marks to be seen, seen, wrong finds, silent errors, gaps, and gaps that ended late."""

    due: int
    seen: int
    wrong: int
    silent: int
    gaps: int
    late: int


def hard(seed: int = 1) -> None:
    """Print a line for each kind of trouble, and their sum."""
    print(f"\n{'':>20} {'codec':>6} {'marks':>6} {'seen':>7} {'wrong':>6} {'> 4 sigma':>10} {'gaps':>5} {'late':>5}")
    tallies = []
    for kind, trouble in TROUBLES.items():
        for codec in ("h264", "mjpeg"):
            rng = np.random.default_rng([seed, list(TROUBLES).index(kind)])
            tables: Tables = {"motion": _circle(rng), "exposure": {"time_s": 0.004}} | trouble(rng)
            scene = Scene.model_validate(
                {"format": 1, "duration_s": SECONDS, "seed": seed, "encoding": {"codec": codec}} | tables
            )
            tallies.append(measured(scene))
            _print(kind, codec, tallies[-1])
    _print("all", "", Tally(*(sum(getattr(one, field.name) for one in tallies) for field in fields(Tally))))


def _print(kind: str, codec: str, one: Tally) -> None:
    print(
        f"{kind:>20} {codec:>6} {one.due:6d} {one.seen / max(one.due, 1):7.2%} {one.wrong:6d}"
        f" {one.silent / max(one.seen, 1):10.2%} {one.gaps:5d} {one.late:5d}",
        flush=True,
    )


def measured(scene: Scene) -> Tally:
    """Render, track, compare."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("clip.avi" if scene.encoding.codec == "mjpeg" else "clip.mp4")
        truth = render_clip(scene, path)
        table = track(open_recording(path))
    # Both fields of a frame are shown at its time; what tells them apart is when they were exposed.
    shown = truth["time_s"] - truth["time_s"][0] if "field" in truth else truth["presentation_s"]
    rows = truth.iloc[np.abs(shown.to_numpy() - table["time_s"].to_numpy()[:, None]).argmin(axis=1)]
    tallies = [_of_mark(table, rows.reset_index(drop=True), name) for name in ("green", "yellow")]
    return Tally(*(sum(getattr(one, field.name) for one in tallies) for field in fields(Tally)))


def _of_mark(table: pd.DataFrame, truth: pd.DataFrame, name: str) -> Tally:
    x, y = f"{name}_x_px", f"{name}_y_px"
    error = table[[x, y]].to_numpy() - truth[[x, y]].to_numpy()
    sigma = table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy()
    seen = np.isfinite(error).all(axis=1)
    wrong = seen & (np.hypot(*error.T) > RADIUS_PX / 2)
    silent = seen & (np.abs(error) > 4 * sigma).any(axis=1)
    repeated = truth["time_s"].diff().fillna(1.0).to_numpy() < 1e-9
    # Wholly in view, and free: a mark behind a wire or in the image before may be absent.
    due = (truth[f"{name}_visible"].to_numpy() > 0.999) & ~repeated
    gaps = late = 0
    for k in np.flatnonzero(due[1:-2] & ~due[:-3]) + 1:
        if due[k : k + 3].all():
            gaps += 1
            late += not seen[k : k + 3].any()
    return Tally(int(due.sum()), int((seen & due).sum()), int(wrong.sum()), int(silent.sum()), gaps, late)
