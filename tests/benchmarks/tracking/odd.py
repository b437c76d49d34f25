"""Odd recordings: error, error over stated uncertainty and times of one drawn clip in every kind of recording."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.evaluator.tracking.odd_recordings import KINDS, drawn, write


def odd(seed: int = 1, only: tuple[str, ...] = ()) -> None:
    """Print a line for each kind of recording."""
    clip = drawn(seed)
    print(f"\n{'':>32} {'frames':>6} {'found':>7} {'error px':>9} {'err/sigma':>9} {'time error ms':>13}  notes")
    for name, kind in KINDS.items():
        if only and name not in only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                path, times, numbers = write(Path(folder), kind, clip.frames)
                recording = open_recording(path, rate_hz=kind.rate_hz)
                table = track(recording)
            except InputError as error:
                print(f"{name:>32} refused: {error}".replace(folder, ""))
                continue
            notes = "; ".join(recording.report().notes)
        if len(table) != len(times):
            print(f"{name:>32} {len(table):6d} of {len(times)} frames  {notes}")
            continue
        errors, normal = [], []
        for mark, truth in clip.truth.items():
            error = table[[f"{mark}_x_px", f"{mark}_y_px"]].to_numpy(float) - truth[numbers]
            errors.append(error)
            normal.append(error / table[[f"{mark}_x_sigma_px", f"{mark}_y_sigma_px"]].to_numpy(float))
        seen = np.isfinite(errors)
        late = table["time_s"].to_numpy() - times
        print(
            f"{name:>32} {len(table):6d} {seen.mean():7.1%} {np.sqrt(np.nanmean(np.square(errors))):9.3f}"
            f" {np.sqrt(np.nanmean(np.square(normal))):9.2f} {1e3 * np.abs(late - late[0]).max():13.3f}  {notes}",
            flush=True,
        )
