"""How fast the studio plays and steps a recording in Chromium, and its memory over minutes of scrubbing.

    python -m tests.benchmarks.studio_playback FOLDER [--minutes 3]

FOLDER: with an experiment whose first run is a recording; once it is analysed (`turnscope compare … -o out` beside it)
it is played with overlay and curves. Steps: from the key to the drawn frame, forward through frames that were not shown
before, four a second. Played: different frames shown in a second, of five seconds after the first. Scrubbed: the time
axis is dragged to and fro by a mouse without rest and let go every second, in another run each half minute; memory is
that of the studio's processes and of the page's process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.studio import memory_mb
from tests.evaluator.browser import BROWSER

PLAYED_S = 5.0  # the shortest sample lasts longer
HELD_S = 1.0
SHOWN = """(seconds) => new Promise((done) => { const axis = document.querySelector(".axis"), seen = new Set();
    const began = performance.now(), gaps = []; let last = began;
    const look = (now) => { const before = seen.size; seen.add(axis.getAttribute("aria-valuenow"));
        if (seen.size > before) { gaps.push(now - last); last = now; }
        now - began < 1000 * seconds ? requestAnimationFrame(look) : done([seen.size, now - began, gaps]); };
    requestAnimationFrame(look); })"""
STEPS = """async (count) => { const kind = CanvasRenderingContext2D.prototype, real = kind.drawImage, took = [];
    let drawn = 0;
    kind.drawImage = function (...given) { real.apply(this, given);
        if (given[0] instanceof ImageBitmap && this.canvas.classList.contains("film")) drawn = performance.now(); };
    for (let k = 0; k < count; k++) {
        await new Promise((done) => setTimeout(done, 250));
        const began = performance.now();
        drawn = 0;
        document.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
        while (!drawn) await new Promise(requestAnimationFrame);
        took.push(drawn - began); }
    kind.drawImage = real;
    return took; }"""


def descendants(process_id: int) -> dict[int, str]:
    """Command lines of the processes below one, by id."""
    parents = {}
    for place in Path("/proc").iterdir():
        if place.name.isdecimal():
            try:
                stat = (place / "stat").read_text()
                line = (place / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            parents[int(place.name)] = (int(stat.rsplit(")", 1)[1].split()[1]), line)
    found = {process_id: ""}
    while new := {one: line for one, (parent, line) in parents.items() if parent in found and one not in found}:
        found |= new
    del found[process_id]
    return found


def memory_of(studio: int, played: int) -> tuple[float, float, float]:
    """Resident memory, MB: of the studio's server, of its child processes, of the page's."""
    children = [one for one, line in descendants(studio).items() if "resource_tracker" not in line]
    pages = [one for one, line in descendants(played).items() if "--type=renderer" in line]
    return memory_mb(studio), sum(map(memory_mb, children)), max(map(memory_mb, pages), default=float("nan"))


def processor_s(process_id: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def play(page: Any, studio: int) -> str:
    """A line of figures."""
    ours = [studio, *descendants(studio)]
    browsers = [one for one, line in descendants(os.getpid()).items() if "chrom" in line and one not in ours]
    page.locator(".film").focus()
    page.keyboard.press("Home")
    page.get_by_role("button", name="Play").click()
    page.wait_for_timeout(1000)
    before = [sum(map(processor_s, group)) for group in (ours, browsers)]
    shown, took, gaps = page.evaluate(SHOWN, PLAYED_S)
    spent = [sum(map(processor_s, group)) - was for group, was in zip((ours, browsers), before, strict=True)]
    page.get_by_role("button", name="Pause").click()
    each = " and ".join(f"{1000 * one / shown:.1f}" for one in spent)
    apart = f"between frames {np.median(gaps):.1f} ms, p95 {np.percentile(gaps, 95):.0f}"
    return f"{1000 * shown / took:.1f} frames/s; {apart}; processor time a frame, studio and browser: {each} ms"


def step(page: Any, count: int = 50) -> str:
    """A line of figures."""
    page.locator(".film").focus()
    page.keyboard.press("Home")
    page.wait_for_timeout(1000)
    took = page.evaluate(STEPS, count)
    return f"median {np.median(took):.1f} ms, p95 {np.percentile(took, 95):.1f}, longest {max(took):.1f}"


def scrub(page: Any, seconds: float) -> None:
    """Drag the time axis to and fro; where it is let go the exact frame is shown, while it is dragged the key frame."""
    box, rng = page.locator(".axis").bounding_box(), np.random.default_rng(0)
    y, until = box["y"] + box["height"] - 3, time.monotonic() + seconds
    while time.monotonic() < until:
        page.mouse.move(box["x"] + 12 + rng.random() * (box["width"] - 24), y)
        page.mouse.down()
        held = time.monotonic() + HELD_S
        while time.monotonic() < held:
            page.mouse.move(box["x"] + 12 + rng.random() * (box["width"] - 24), y, steps=6)
        page.mouse.up()


def choose(page: Any, number: int) -> None:
    """Another run of the table, by its first cell."""
    cells = page.locator("input[data-key=id]")
    cell = cells.nth(number % cells.count())
    run = cell.input_value()
    cell.click()
    page.locator(f"[aria-label='Frame of {run}']").wait_for(timeout=120_000)


def main() -> None:
    """Print the figures."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=3.0)
    given = parser.parse_args()
    command = [sys.executable, "-m", "evaluator", "studio", str(given.folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as chromium:
        assert server.stdout is not None
        link = next(line.strip() for line in server.stdout if "token=" in line)
        browser = chromium.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(link)
        page.locator("a.card").first.click()
        page.locator(".axis").wait_for(timeout=120_000)
        print(f"load {os.getloadavg()[0]:.1f}; steps: {step(page)}", flush=True)
        print(f"load {os.getloadavg()[0]:.1f}; played: {play(page, server.pid)}", flush=True)
        print(f"load {os.getloadavg()[0]:.1f}; played again: {play(page, server.pid)}", flush=True)
        print("memory, MB: server, its processes, page; frames asked for")
        asked: list[str] = []
        page.on("request", lambda request: asked.append("") if "/frame?" in request.url else None)
        for half in range(round(2 * given.minutes) + 1):
            told = " ".join(f"{value:.0f}" for value in memory_of(server.pid, os.getpid()))
            print(f"after {half / 2:g} min: {told}; {len(asked)}", flush=True)
            choose(page, half)
            scrub(page, 30 if half < round(2 * given.minutes) else 0)
        browser.close()
        server.terminate()


if __name__ == "__main__":
    main()
