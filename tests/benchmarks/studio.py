"""How fast and how exact the studio shows frames: random seeks in clips that carry their frame number, and first paint.

    python -m tests.benchmarks.studio [--seeks 1000] [--clip "1920x1080"]

Clips: GOP 12 and 250, B-frames, variable rate, 640 x 480 and 1920 x 1080, MP4, Matroska and MPEG-TS. A seek is timed
from the question to the JPEG, through the decoder process. The number in every frame is read back.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from evaluator.workflow import Decoder, Wanted
from tests.evaluator.counted_clip import encoded, number_in, numbered

# name, container, width, height, frames, group, B-frames, ticks between frames at most
CLIPS = (
    ("640x480, GOP 12", "mp4", 640, 480, 1200, 12, 0, 1),
    ("640x480, GOP 12, B-frames, variable rate", "mp4", 640, 480, 1200, 12, 3, 4),
    ("640x480, GOP 250, B-frames", "mkv", 640, 480, 1200, 250, 3, 1),
    ("640x480, GOP 12, B-frames", "ts", 640, 480, 1200, 12, 2, 1),
    ("1920x1080, GOP 12, B-frames", "mp4", 1920, 1080, 360, 12, 2, 1),
)


def clip(folder: Path, number: int) -> Path:
    """Encode a clip: noise that moves, and the number of the frame in a row of squares."""
    _, kind, width, height, frames, group, b_frames, step = CLIPS[number]
    path, rng = folder / f"{number}.{kind}", np.random.default_rng(number)
    texture = rng.integers(60, 140, (height, 2 * width, 3), dtype=np.uint8)
    moving = (texture[:, index % width : index % width + width] for index in range(frames))
    images = (numbered(image, index, height // 8, (20, 230)) for index, image in enumerate(moving))
    return encoded(path, images, rng, group, b_frames, step, {"crf": "23", "preset": "veryfast"})


def number_of(jpeg: bytes) -> int:
    """The number that a frame shows."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return number_in(np.asarray(image), image.shape[0] // 8, 125.0)


def timed(decoder: Decoder, wanted: Wanted) -> tuple[float, int, int]:
    """Milliseconds, the number that was given, and the number that is shown."""
    began = time.perf_counter()
    ((index, jpeg),) = decoder.frames(wanted)
    return 1000 * (time.perf_counter() - began), index, number_of(jpeg)


def seeks(decoder: Decoder, path: Path, count: int) -> str:
    """A line of figures."""
    total, rng = len(decoder.contents(path)["time_s"]), np.random.default_rng(1)
    exact, wrong = [], 0
    for index in map(int, rng.integers(0, total, count)):
        took, given, shown = timed(decoder, Wanted(path, index))
        exact.append(took)
        wrong += (given, shown) != (index, index)
    near = [timed(decoder, Wanted(path, int(i), near=True))[0] for i in rng.integers(0, total, 200)]
    timed(decoder, Wanted(path, total // 2 + 3))  # decodes what the steps show
    steps = [timed(decoder, Wanted(path, total // 2 + i))[0] for i in (1, 0, 1, 2, 1, 0)]
    at = [f"{np.percentile(exact, 50):6.1f}", f"{np.percentile(exact, 95):6.1f}", f"{np.percentile(near, 95):6.1f}"]
    return f"{wrong:5d} {' '.join(at)} {max(steps):6.1f}"


def memory_mb(process_id: int) -> float:
    """Resident memory of a process."""
    text = Path(f"/proc/{process_id}/status").read_text()
    return int(next(line for line in text.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024


def first_paint_ms(folder: Path) -> list[float]:
    """First contentful paint of the first screen, three times, in Chromium; empty where there is none."""
    from tests.evaluator.browser import BROWSER

    if BROWSER is None:
        return []
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-m", "evaluator", "studio", str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as play:
        assert server.stdout is not None
        link = next(line.strip() for line in server.stdout if "token=" in line)
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        found = []
        for _ in range(3):
            page = browser.new_context().new_page()
            page.goto(link)
            page.locator("h1").wait_for()
            found.append(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime"))
        browser.close()
        server.terminate()
    return found


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeks", type=int, default=1000, help="of all clips together")
    parser.add_argument("--clip", default="", help="those only whose name holds this")
    given = parser.parse_args()
    each = given.seeks // len(CLIPS)
    with tempfile.TemporaryDirectory() as name:
        decoder, folder = Decoder(), Path(name)
        decoder.start()
        print(f"{each} random seeks a clip, ms; steps of one frame within a group")
        print(f"{'clip':45s} {'wrong':>5s} {'p50':>6s} {'p95':>6s} {'near':>6s} {'step':>6s}")
        before = 0.0
        for number, (words, kind, *_) in enumerate(CLIPS):
            if given.clip not in words:
                continue
            path = clip(folder, number)
            print(f"{f'{words}, {kind}':45s} {seeks(decoder, path, each)}", flush=True)
            assert decoder.process_id is not None
            before = before or memory_mb(decoder.process_id)
        print(f"memory of the decoder: {before:.0f} MB after the first clip, ", end="")
        print(f"{memory_mb(decoder.process_id or 0):.0f} MB after the last")
        decoder.close()
        paints = first_paint_ms(folder)
        print(f"first paint: {', '.join(f'{value:.0f}' for value in paints) or 'no Chromium here'} ms")


if __name__ == "__main__":
    main()
