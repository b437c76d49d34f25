"""Figures of the tracker: error against the Cramér-Rao bound, H.264 error and speed beside peers, live latency.

    python -m tests.benchmarks.tracking [bound] [h264] [speed] [live]

Truth is exact: clips are drawn here by supersampling. Peers run in the same process on the same clips: an HSV mask
centroid, an OpenCV contour tracker, a luma-weighted centroid and trackpy (pip install turnscope[bench]). Only ratios of
one run mean anything on a shared machine.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from evaluator.recording import Frame, open_recording
from evaluator.tracking import TrackingSettings, track
from evaluator.tracking.tracker import Tracker
from tests.evaluator.tracking.synthetic import GREEN, YELLOW, coverage, draw, turning_marks, write_video

Array = np.ndarray
LUMA = np.array([0.299, 0.587, 0.114])


def frames_in_memory(pictures: list[Array]) -> Iterator[Frame]:
    """Luma and full-resolution colour planes without any codec."""
    for index, picture in enumerate(pictures):
        luma = picture @ LUMA
        u, v = 128 + (picture[..., 2] - luma) / 1.772, 128 + (picture[..., 0] - luma) / 1.402
        planes = [np.clip(np.rint(plane), 0, 255).astype(np.uint8) for plane in (luma, u, v)]
        yield Frame(
            index, index, Fraction(1, 60), *planes, 8, full_range=True, matrix="bt601", row_origin=0, row_step=1,
            kind="", repeated=False, owner=None,
        )  # fmt: skip


def bound_px(radius: float, blur: float, snr: float) -> float:
    """Cramér-Rao bound per axis of the centre of a disc whose edge is blurred by a Gaussian."""
    return float(np.sqrt(2 * np.sqrt(np.pi) * blur / (np.pi * radius)) / snr)


def bound() -> None:
    """Error of lossless clips over the bound, pixel locking, and the normalised error."""
    print("lossless, 150 pictures of slow drift; s: blur of the lens, to which pixels add 1/12 px²")
    print(
        f"{'R px':>5} {'s px':>5} {'SNR':>4} {'error px':>9} {'/ bound':>8} {'sd error/sigma':>15} {'locking px':>11}"
    )
    rng = np.random.default_rng(5)
    for radius, blur, snr in [
        (3, 0.5, 10), (3, 0.5, 60), (3, 1.0, 30), (3, 1.5, 30), (5, 0.8, 30), (10, 0.5, 10), (10, 0.8, 30),
        (10, 0.8, 60),
        (20, 0.5, 60), (20, 1.5, 10), (20, 1.5, 60),
    ]:  # fmt: skip
        pictures, truth = still_pictures(rng, radius, blur, snr)
        table = track(frames_in_memory(pictures))
        error = table[["green_x_px", "green_y_px"]].to_numpy() - truth
        normal = error / table[["green_x_sigma_px", "green_y_sigma_px"]].to_numpy()
        phase = truth % 1.0 * 2 * np.pi
        locking = 2 * np.hypot((error * np.cos(phase)).mean(), (error * np.sin(phase)).mean())
        rms = np.sqrt(np.nanmean(error**2))
        print(
            f"{radius:5g} {blur:5g} {snr:4g} {rms:9.4f} {rms / bound_px(radius, blur, snr):8.2f}"
            f" {np.nanstd(normal):15.2f} {locking:7.4f} ±{2 * rms / np.sqrt(error.size):.4f}"
        )


def still_pictures(rng: np.random.Generator, radius: float, blur: float, snr: float) -> tuple[list[Array], Array]:
    """Two marks on black, drifting slowly over all places within a pixel; pictures and centres of the green one."""
    distance = 3.66 * 2 * radius
    size = (int(distance + 5 * radius + 24), int(5 * radius + 24))
    pictures, truth = [], []
    for k in range(150):
        green = np.array(size) / 2 - [distance / 2, 0] + [0.047 * (k - 75), 0.031 * (k - 75)]
        picture = np.full((size[1], size[0], 3), 25.0)
        for place, color in ((green, GREEN), (green + np.array([distance, 0.0]), YELLOW)):
            share = coverage(size, tuple(place), radius, blur)[..., None]
            picture = picture * (1 - share) + share * np.array(color)
        # The same noise in all channels: it is the luma's then; SNR is that of the green mark.
        noise = (np.array(GREEN) @ LUMA - 25.0) / snr
        picture += rng.normal(0, noise, picture.shape[:2])[..., None]
        pictures.append(np.clip(picture, 0, 255))
        truth.append(green)
    return pictures, np.array(truth)


def clip(folder: Path, size: tuple[int, int], codec: str, scale: float, frames: int) -> tuple[Path, dict[str, Array]]:
    """A robot on a circle, encoded; the truth of its marks."""
    rng = np.random.default_rng(1)
    truth = turning_marks(frames, (size[0] / 2, size[1] / 2), 0.2 * size[1], scale, 0.004)
    pictures = [
        draw(rng, size, {name: tuple(points[k]) for name, points in truth.items()}, scale / 2, 0.8, 2.0)
        for k in range(frames)
    ]
    options = {"crf": "18"} if codec == "libx264" else {"qmin": "3", "qmax": "3"}
    pixels = "yuv420p" if codec == "libx264" else "yuvj420p"
    name = folder / f"{codec}-{size[0]}.{'mp4' if codec == 'libx264' else 'avi'}"
    return write_video(name, pictures, codec=codec, pixels=pixels, options=options), truth


RANGES = {"green": ((45, 90, 80), (80, 255, 255)), "yellow": ((22, 90, 80), (38, 255, 255))}


def with_masks(path: Path, place: Callable[[Array], tuple[float, float]]) -> dict[str, Array]:
    """Read, HSV, inRange, full frame; place: from the mask of a colour to a centre."""
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in RANGES}
    capture = cv2.VideoCapture(str(path))
    while True:
        good, picture = capture.read()
        if not good:
            return {name: np.array(points) for name, points in places.items()}
        hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
        for name, (low, high) in RANGES.items():
            places[name].append(place(cv2.inRange(hsv, low, high)))


def hsv_centroid(path: Path) -> dict[str, Array]:
    """The usual pipeline: moments of the mask."""

    def center(mask: Array) -> tuple[float, float]:
        moments = cv2.moments(mask, binaryImage=True)
        area = moments["m00"] or np.nan
        return moments["m10"] / area, moments["m01"] / area

    return with_masks(path, center)


def contours(path: Path) -> dict[str, Array]:
    """OpenCV contour tracker: the largest contour of each colour, centre of its smallest circle."""

    def center(mask: Array) -> tuple[float, float]:
        found, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return cv2.minEnclosingCircle(max(found, key=cv2.contourArea))[0] if found else (np.nan, np.nan)

    return with_masks(path, center)


def luma_centroid(path: Path, truth: dict[str, Array], radius: float) -> dict[str, Array]:
    """Luma-weighted centroid in a window that is handed the truth: what a perfect finder would leave to it."""
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in truth}
    half = int(1.4 * radius + 2)
    grid_y, grid_x = np.mgrid[-half : half + 1, -half : half + 1]
    for frame in open_recording(path):
        for name, points in truth.items():
            x, y = np.rint(points[frame.index]).astype(int)
            window = frame.luma[y - half : y + half + 1, x - half : x + half + 1].astype(float)
            weight = np.clip(window - np.percentile(window, 20), 0, None)
            weight /= weight.sum()
            places[name].append((x + (weight * grid_x).sum(), y + (weight * grid_y).sum()))
    return {name: np.array(points) for name, points in places.items()}


def trackpy_places(path: Path, truth: dict[str, Array], radius: float) -> dict[str, Array]:
    """trackpy.locate on the luma; its features told apart by the truth."""
    import trackpy

    trackpy.quiet()
    places: dict[str, list[Array]] = {name: [] for name in truth}
    diameter = int(2 * radius) // 2 * 2 + 3
    for frame in open_recording(path):
        found = trackpy.locate(frame.luma, diameter, topn=12, engine="numba")[["x", "y"]].to_numpy()
        for name, points in truth.items():
            away = np.hypot(*(found - points[frame.index]).T)
            places[name].append(found[np.argmin(away)] if len(found) and away.min() < radius else np.full(2, np.nan))
    return {name: np.array(points) for name, points in places.items()}


def ours(path: Path) -> dict[str, Array]:
    """The whole tracker, file to table."""
    table = track(open_recording(path))
    return {name: table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() for name in ("green", "yellow")}


def h264() -> None:
    """Error and speed on H.264 4:2:0 at quality 18, marks of 5 and 8 px radius, beside peers."""
    for scale in (10.0, 16.0):
        with tempfile.TemporaryDirectory() as folder:
            path, truth = clip(Path(folder), (640, 480), "libx264", scale, 240)
            radius = scale / 2
            peers: dict[str, Callable[[], dict[str, Array]]] = {
                "turnscope": lambda path=path: ours(path),
                "luma-weighted centroid": lambda path=path, t=truth, r=radius: luma_centroid(path, t, r),
                "HSV mask centroid": lambda path=path: hsv_centroid(path),
                "OpenCV contours": lambda path=path: contours(path),
                "trackpy": lambda path=path, t=truth, r=radius: trackpy_places(path, t, r),
            }
            print(f"\nH.264 4:2:0, quality 18, marks of {radius:g} px radius, 240 pictures of 640×480")
            print(f"{'':>24} {'error px':>9} {'missed':>7} {'pictures/s':>11} {'centre µm':>10} {'heading deg':>12}")
            for name, run in peers.items():
                try:
                    run()  # compiled and cached
                    began = time.perf_counter()
                    places = run()
                except ImportError:
                    print(f"{name:>24} (not installed)")
                    continue
                rate = 240 / (time.perf_counter() - began)
                error = np.stack([places[mark] - truth[mark] for mark in ("green", "yellow")])
                across = truth["yellow"] - truth["green"]
                spacing = np.hypot(*across.T)[:, None]
                along, normal = across / spacing, np.stack([-across[:, 1], across[:, 0]], axis=-1) / spacing
                turn = ((error[1] - error[0]) * normal).sum(axis=1) / spacing[:, 0]
                lever = 1.55 * scale
                center = error.mean(axis=0) + lever * turn[:, None] * along
                print(
                    f"{name:>24} {np.sqrt(np.nanmean(error**2)):9.4f} {np.isnan(error).any(axis=2).mean():7.1%}"
                    f" {rate:11.0f} {1000 / scale * np.sqrt(np.nanmean(center**2)):10.2f}"
                    f" {np.degrees(np.sqrt(np.nanmean(turn**2))):12.4f}"
                )


def decode(path: Path) -> int:
    """Merely decode, with all threads."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        return sum(1 for _ in container.decode(stream))


def speed() -> None:
    """End-to-end speed over decoding alone and over the usual OpenCV pipeline; medians of alternating runs."""
    print(f"\n{'':>22} {'decode /s':>10} {'track /s':>9} {'OpenCV /s':>10} {'track/decode':>13} {'track/OpenCV':>13}")
    for size, scale, repeat in (((640, 480), 16.0, 16), ((1920, 1080), 40.0, 4)):
        for codec in ("libx264", "mjpeg"):
            with tempfile.TemporaryDirectory() as folder:
                short, _ = clip(Path(folder), size, codec, scale, 120)
                path = lengthen(short, repeat)
                tasks = {"decode": decode, "track": ours, "opencv": hsv_centroid}
                seconds: dict[str, list[float]] = {name: [] for name in tasks}
                ours(path)
                for _ in range(5):
                    for name, task in tasks.items():
                        began = time.perf_counter()
                        task(path)
                        seconds[name].append(time.perf_counter() - began)
                best = {name: 120 * repeat / np.median(values) for name, values in seconds.items()}
                print(
                    f"{codec + ' ' + str(size[0]) + '×' + str(size[1]):>22} {best['decode']:10.0f} {best['track']:9.0f}"
                    f" {best['opencv']:10.0f} {best['track'] / best['decode']:13.2f}"
                    f" {best['track'] / best['opencv']:13.2f}"
                )


def lengthen(path: Path, repeat: int) -> Path:
    """The same packets over and over: a long recording without encoding one."""
    longer = path.with_stem(path.stem + "-long")
    with av.open(str(path)) as source, av.open(str(longer), "w") as target:
        stream = source.streams.video[0]
        copy = target.add_stream_from_template(stream)
        packets = [(bytes(p), p.pts, p.dts, p.is_keyframe) for p in source.demux(stream) if p.dts is not None]
        span = max(pts for _, pts, _, _ in packets) + packets[1][1] - packets[0][1] if len(packets) > 1 else 1
        span = round(Fraction(len(packets)) / stream.average_rate / stream.time_base)
        for k in range(repeat):
            for data, pts, dts, key in packets:
                packet = av.Packet(data)
                packet.stream, packet.pts, packet.dts, packet.is_keyframe = copy, pts + k * span, dts + k * span, key
                packet.time_base = stream.time_base
                target.mux(packet)
    return longer


def live(seconds: float = 20.0) -> None:
    """Latency from the arrival of a picture to its marks, at 60 pictures a second of 640×480."""
    with tempfile.TemporaryDirectory() as folder:
        path, _ = clip(Path(folder), (640, 480), "mjpeg", 16.0, 120)
        frames = list(open_recording(path))
        tracker, waits, late = Tracker(TrackingSettings()), [], 0
        arrivals: list[float] = []
        began = time.perf_counter()

        def paced() -> Iterator[Frame]:
            nonlocal late
            for k in range(int(60 * seconds)):
                due = began + k / 60
                late += time.perf_counter() > due + 1 / 60
                while time.perf_counter() < due:
                    time.sleep(max(0.0, min(0.002, due - time.perf_counter())))
                arrivals.append(time.perf_counter())
                there_and_back = k % 238
                source = frames[there_and_back if there_and_back < 120 else 238 - there_and_back]
                yield Frame(k, k, Fraction(1, 60), source.luma, source.u, source.v, 8, full_range=True, matrix="bt601",
                            row_origin=0, row_step=1, kind="", repeated=False, owner=source)  # fmt: skip

        for frame, _ in tracker.run(paced()):
            waits.append(time.perf_counter() - arrivals[frame.index])
        wait = 1000 * np.array(waits[12:])
        print(
            f"\nlive, {seconds:g} s at 60/s: {len(waits)} of {int(60 * seconds)} pictures out, {late} a picture late;"
        )
        print(f"  latency median {np.median(wait):.2f} ms, 99.9 % {np.quantile(wait, 0.999):.2f} ms; within 8 ms"
              f" {np.mean(wait < 8):.2%} (the first 12 pictures wait for the marks' shape to be learnt)")  # fmt: skip


if __name__ == "__main__":
    parts = {"bound": bound, "h264": h264, "speed": speed, "live": live}
    for chosen in sys.argv[1:] or list(parts):
        parts[chosen]()
