"""Clips with exact truth."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.evaluator.tracking.synthetic import GREEN, LUMA, YELLOW, coverage, draw, turning_marks, write_video

Array = np.ndarray


def distance_px(radius: float) -> float:
    """From the green mark to the yellow one, on the paper's robot."""
    return 3.66 * 2 * radius


def still_images(rng: np.random.Generator, radius: float, blur: float, snr: float) -> tuple[list[Array], Array]:
    """Two marks on black, drifting slowly over all places within a pixel; images and centres of the green one."""
    distance = distance_px(radius)
    size = (int(distance + 5 * radius + 24), int(5 * radius + 24))
    images, truth = [], []
    for k in range(150):
        green = np.array(size) / 2 - [distance / 2, 0] + [0.047 * (k - 75), 0.031 * (k - 75)]
        image = np.full((size[1], size[0], 3), 25.0)
        for place, color in ((green, GREEN), (green + np.array([distance, 0.0]), YELLOW)):
            share = coverage(size, tuple(place), radius, blur)[..., None]
            image = image * (1 - share) + share * np.array(color)
        # The same noise in all channels: it is the luma's then; SNR is that of the green mark.
        noise = (np.array(GREEN) @ LUMA - 25.0) / snr
        image += rng.normal(0, noise, image.shape[:2])[..., None]
        images.append(np.clip(image, 0, 255))
        truth.append(green)
    return images, np.array(truth)


def clip(
    folder: Path,
    size: tuple[int, int],
    codec: str,
    scale: float,
    frames: int,
    *,
    back: bool = False,
    rate: str = "crf",
    noise: float = 2.0,
    turn_rad: float = 0.004,
) -> tuple[Path, dict[str, Array]]:
    """A robot on a circle, encoded; the truth of its marks.

    back: it also drives back to the start, to be repeated. rate: how H.264 is told its quality of 18: "crf" (a quality
    that is felt: what moves gets less) or "qp" (one quantiser for all). noise: of the sensor, levels. turn_rad: of the
    robot, a image.
    """
    rng = np.random.default_rng(1)
    truth = turning_marks(frames, (size[0] / 2, size[1] / 2), 0.2 * size[1], scale, turn_rad)
    images = [
        draw(rng, size, {name: tuple(points[k]) for name, points in truth.items()}, scale / 2, 0.8, noise)
        for k in range(frames)
    ]
    if back:
        images += images[-2:0:-1]
    options = {rate: "18"} if codec == "libx264" else {"qmin": "3", "qmax": "3"}
    pixels = "yuv420p" if codec == "libx264" else "yuvj420p"
    name = folder / f"{codec}-{size[0]}.{'mp4' if codec == 'libx264' else 'avi'}"
    return write_video(name, images, codec=codec, pixels=pixels, options=options), truth


def lengthen(path: Path, repeat: int) -> Path:
    """Repeat the packets of a clip: a long recording without encoding one."""
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
