"""Error against the Cramér-Rao bound, and on H.264 beside peers."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.benchmarks.tracking.clips import clip, distance_px, still_images
from tests.benchmarks.tracking.peers import contours, hsv_centroid, luma_centroid, ours, trackpy_places, true_shape
from tests.evaluator.tracking.synthetic import frames_in_memory

Array = np.ndarray


def bound_px(radius: float, blur: float, snr: float) -> float:
    """Cramér-Rao bound per axis of the centre of a disc whose edge is blurred by a Gaussian."""
    return float(np.sqrt(2 * np.sqrt(np.pi) * blur / (np.pi * radius)) / snr)


def bound() -> None:
    """Error of lossless clips over the bound, pixel locking, and the normalised error."""
    print("lossless, 150 images of slow drift; s: blur of the lens, to which pixels add 1/12 px²")
    print(
        f"{'R px':>5} {'s px':>5} {'SNR':>4} {'error px':>9} {'/ bound':>8} {'sd error/sigma':>15} {'locking px':>11}"
    )
    rng = np.random.default_rng(5)
    for radius, blur, snr in [
        (3, 0.5, 10), (3, 0.5, 60), (3, 1.0, 30), (3, 1.5, 30), (5, 0.8, 30), (10, 0.5, 10), (10, 0.8, 30),
        (10, 0.8, 60),
        (20, 0.5, 60), (20, 1.5, 10), (20, 1.5, 60),
    ]:  # fmt: skip
        images, truth = still_images(rng, radius, blur, snr)
        table = track(frames_in_memory(images))
        error = table[["green_x_px", "green_y_px"]].to_numpy() - truth
        both = {"green": truth, "yellow": truth + np.array([distance_px(radius), 0.0])}
        normal = np.concatenate([_normal(table, name, points) for name, points in both.items()])
        phase = truth % 1.0 * 2 * np.pi
        locking = 2 * np.hypot((error * np.cos(phase)).mean(), (error * np.sin(phase)).mean())
        rms = np.sqrt(np.nanmean(error**2))
        print(
            f"{radius:5g} {blur:5g} {snr:4g} {rms:9.4f} {rms / bound_px(radius, blur, snr):8.2f}"
            f" {np.nanstd(normal):15.2f} {locking:7.4f} ±{2 * rms / np.sqrt(error.size):.4f}"
        )


def _normal(table: pd.DataFrame, name: str, truth: Array) -> Array:
    """Errors of a mark over their stated uncertainties."""
    error = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - truth
    return np.asarray(error / table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy())


def h264() -> None:
    """Error and speed on H.264 4:2:0 at quality 18, marks of 5 and 8 px radius, beside peers and the codec's limit."""
    for rate, said in (("crf", "constant rate factor 18"), ("qp", "constant quantiser 18")):
        for scale in (10.0, 16.0):
            with tempfile.TemporaryDirectory() as folder:
                path, truth = clip(Path(folder), (640, 480), "libx264", scale, 240, rate=rate)
                radius = scale / 2
                print(f"\nH.264 4:2:0, {said}, marks of {radius:g} px radius, 240 images of 640×480")
                _beside_peers(path, truth, scale)


def conditions() -> None:
    """Error on H.264 at constant rate factor 18, marks of 5 px radius, over sensor noise and motion.

    What a codec does to a mark depends on both: a quality that is felt spends less on what moves, and noise keeps
    blocks from being copied. Figures of other clips are to be compared where the peers do as well as on those.
    """
    print("\nerror px, H.264 4:2:0, constant rate factor 18, marks of 5 px radius, 120 images of 640×480")
    print(f"{'noise':>6} {'px a image':>13} {'HSV mask':>9} {'luma':>7} {'true shape':>11} {'turnscope':>10}")
    for noise in (0.5, 2.0, 4.0):
        for turn_rad in (0.001, 0.002, 0.004, 0.016):
            with tempfile.TemporaryDirectory() as folder:
                path, truth = clip(Path(folder), (640, 480), "libx264", 10.0, 120, noise=noise, turn_rad=turn_rad)
                found = hsv_centroid(path), luma_centroid(path, truth, 5.0), true_shape(path, truth, 5.0), ours(path)
            step = np.hypot(*np.diff(truth["green"], axis=0).T).mean()
            mask, luma, shape, own = (
                _rms(np.stack([places[mark] - truth[mark] for mark in ("green", "yellow")])) for places in found
            )
            print(f"{noise:6g} {step:13.2f} {mask:9.4f} {luma:7.4f} {shape:11.4f} {own:10.4f}")


def _beside_peers(path: Path, truth: dict[str, Array], scale: float) -> None:
    radius = scale / 2
    peers: dict[str, Callable[[], dict[str, Array]]] = {
        "turnscope": lambda: ours(path),
        "disc of the true shape": lambda: true_shape(path, truth, radius),
        "luma-weighted centroid": lambda: luma_centroid(path, truth, radius),
        "HSV mask centroid": lambda: hsv_centroid(path),
        "OpenCV contours": lambda: contours(path),
        "trackpy": lambda: trackpy_places(path, truth, radius),
    }
    kinds = np.array([frame.kind for frame in open_recording(path)])
    print(
        f"{'':>24} {'error px':>9} {'I':>7} {'P':>7} {'B':>7} {'missed':>7} {'images/s':>11} {'centre µm':>10}"
        f" {'heading deg':>12}"
    )
    for name, run in peers.items():
        try:
            run()  # compiled and cached
            began = time.perf_counter()
            places = run()
        except ImportError:
            print(f"{name:>24} (not installed)")
            continue
        speed = 240 / (time.perf_counter() - began)
        error = np.stack([places[mark] - truth[mark] for mark in ("green", "yellow")])
        of_kind = " ".join(f"{_rms(error[:, kinds == kind]):7.4f}" for kind in "IPB")
        center, turn = _pose_errors(error, truth["yellow"] - truth["green"], 1.55 * scale)
        print(
            f"{name:>24} {_rms(error):9.4f} {of_kind} {np.isnan(error).any(axis=2).mean():7.1%} {speed:11.0f}"
            f" {1000 / scale * _rms(center):10.2f} {np.degrees(_rms(turn)):12.4f}"
        )


def _rms(error: Array) -> float:
    seen = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")


def _pose_errors(error: Array, across: Array, lever_px: float) -> tuple[Array, Array]:
    """Errors of the robot's centre (n, 2), px, and of its heading (n,), rad, from those of its marks (2, n, 2)."""
    spacing = np.hypot(*across.T)[:, None]
    along, normal = across / spacing, np.stack([-across[:, 1], across[:, 0]], axis=-1) / spacing
    turn = ((error[1] - error[0]) * normal).sum(axis=1) / spacing[:, 0]
    return error.mean(axis=0) + lever_px * turn[:, None] * along, turn
