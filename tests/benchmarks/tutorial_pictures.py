"""Renew the images of the tutorial and of the README: run the tutorial's commands and take screenshots of their output.

    python -m tests.benchmarks.tutorial_pictures

Needs chromium. Writes sample_videos/tutorial/*.png; takes about two minutes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import av
from PIL import Image, ImageChops

from evaluator.workflow.samples import copy_samples

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "sample_videos" / "tutorial"
COMMANDS = (
    "calibrate {gauge_images} --gauge gauge.toml -o camera.json",
    "track turn-33.3-14.4.mp4 --camera camera.json -o turn.csv --overlay turn-marks.mp4",
    "report experiment.toml -o results/",
    "diagnose puzzle/experiment.toml -o puzzle-results/",
    "report puzzle/experiment.toml -o puzzle-results/",
)
# picture: (page, id of the section or figure on it, window in px, width in px of the picture)
SHOTS = {
    "camera.png": ("camera.html", "camera-uncertainty", (900, 700), 540),
    "trajectories.png": ("results/report.html", "trajectories", (900, 492), 640),
    "radius.png": ("results/report.html", "radius-difference", (900, 700), 540),
    "diagnosis.png": ("puzzle-results/report.html", "diagnosis", (900, 700), 640),
    "gap.png": ("puzzle-results/report.html", "gap", (900, 900), 540),
}


def main() -> None:
    """Run the commands, then take every picture."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        copy_samples(folder)
        gauge_images = " ".join(path.name for path in sorted(folder.glob("gauge-*.png")))
        for command in COMMANDS:
            words = command.format(gauge_images=gauge_images).split()
            subprocess.run([sys.executable, "-m", "evaluator", *words], cwd=folder, check=True)
        for name, (page, part, window, width) in SHOTS.items():
            photograph(folder / page, part, window, PICTURES / name, width)
        save(frame_at(folder / "turn-marks.mp4", 7.0), PICTURES / "overlay.png", 480)
    for path in sorted(PICTURES.glob("*.png")):
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def photograph(page: Path, part: str, window: tuple[int, int], target: Path, width: int) -> None:
    """Save the section or figure of a page with the id `part` as a PNG of at most the given width."""
    style = "body *:not(#PART):not(:has(#PART)):not(#PART *) { display: none !important }"
    text = page.read_text(encoding="utf-8")
    text = text.replace("</head>", f"<style>{style.replace('PART', part)}</style></head>", 1)
    with tempfile.TemporaryDirectory() as scratch:
        shown, shot = Path(scratch, "page.html"), Path(scratch, "shot.png")
        shown.write_text(text, encoding="utf-8")
        subprocess.run(
            [
                *(shutil.which("chromium") or "chromium", "--headless", "--no-sandbox", "--disable-gpu"),
                *("--hide-scrollbars", "--virtual-time-budget=4000", f"--user-data-dir={scratch}/profile"),
                *(f"--window-size={window[0]},{window[1]}", f"--screenshot={shot}", shown.as_uri()),
            ],
            check=True,
            capture_output=True,
        )
        with Image.open(shot) as image:
            save(trimmed(image.convert("RGB")), target, width)


def trimmed(image: Image.Image, margin: int = 12) -> Image.Image:
    """Cut off the empty border, except a margin in px."""
    box = ImageChops.difference(image, Image.new("RGB", image.size, image.getpixel((2, image.height - 2)))).getbbox()
    if box is None:
        raise ValueError("the picture is empty: does the page still have a part of that id?")
    left, top, right, bottom = box
    return image.crop(
        (
            max(0, left - margin),
            max(0, top - margin),
            min(image.width, right + margin),
            min(image.height, bottom + margin),
        )
    )


def frame_at(video: Path, time_s: float) -> Image.Image:
    """Return the first frame of a video at or after a time."""
    with av.open(str(video)) as container:
        for frame in container.decode(video=0):
            if frame.time is not None and frame.time >= time_s:
                return frame.to_image()
    raise ValueError(f"{video.name} ends before {time_s} s")


def save(image: Image.Image, target: Path, width: int) -> None:
    """Write a PNG with a palette, scaled down to a width."""
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    image.quantize(256, kmeans=3, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    main()
