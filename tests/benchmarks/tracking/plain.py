"""Marks of any shape, low bitrates, things at rest: tracker and threshold with centroid, on plainly drawn clips."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.evaluator.tracking.plain_video import KINDS, Clip
from tests.evaluator.tracking.scoring import Score, score, threshold_and_centroid


def plain(seed: int = 1, only: tuple[str, ...] = ()) -> None:
    """Print a line for each kind of clip."""
    print(f"\n{'':>24} {'turnscope':^36} | {'threshold and centroid':^26}")
    print(
        f"{'':>24} {'found':>8} {'wrong ok':>8} {'scatter px':>10} {'err/sigma':>9} |"
        f" {'found':>8} {'wrong':>6} {'scatter px':>10}"
    )
    for number, (kind, make) in enumerate(KINDS.items()):
        if not only or kind in only:
            ours, theirs = compared(make(np.random.default_rng([seed, number])))
            print(
                f"{kind:>24} {ours.found:8.1%} {ours.wrong:8d} {ours.scatter_px:10.3f} {ours.normalised:9.2f} |"
                f" {theirs.found:8.1%} {theirs.wrong:6d} {theirs.scatter_px:10.3f}",
                flush=True,
            )


def compared(clip: Clip) -> tuple[Score, Score]:
    """Scores of the tracker and of the threshold on one clip."""
    with tempfile.TemporaryDirectory() as folder:
        path = clip.write(Path(folder))
        table = track(open_recording(path), clip.settings)
        simple = threshold_and_centroid(path, clip)
    places = {name: table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float) for name in clip.truth}
    sigmas = {name: table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy(float) for name in clip.truth}
    return score(clip, places, sigmas), score(clip, simple)
