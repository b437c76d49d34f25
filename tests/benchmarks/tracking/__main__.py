"""Figures of the tracker: error against the Cramér-Rao bound, on H.264, on hard clips; speed; live latency;
marks of any shape, low bitrates and things at rest beside threshold and centroid; odd recordings.

    python -m tests.benchmarks.tracking [bound] [h264] [conditions] [hard] [speed] [live] [plain] [odd]

Truth is exact: clips are drawn by supersampling or by the project's own renderer. Peers run in the same process on the
same clips: an HSV mask centroid, an OpenCV contour tracker, a luma-weighted centroid and trackpy (pip install
turnscope[bench]). Only ratios of one run mean anything on a shared machine.
"""

from __future__ import annotations

import click

from tests.benchmarks.tracking.accuracy import bound, conditions, h264
from tests.benchmarks.tracking.hard import hard
from tests.benchmarks.tracking.live import live
from tests.benchmarks.tracking.odd import odd
from tests.benchmarks.tracking.plain import plain
from tests.benchmarks.tracking.speed import speed

PARTS = ("bound", "h264", "conditions", "hard", "speed", "live", "plain", "odd")


@click.command()
@click.argument("parts", nargs=-1, type=click.Choice(PARTS))
@click.option("--minutes", default=0.5, show_default=True, help="How long the live source lasts.")
@click.option("--seed", default=1, show_default=True, help="Of the hard, the plain and the odd clips.")
def main(parts: tuple[str, ...], minutes: float, seed: int) -> None:
    """Print the figures of PARTS, all of them where none is named."""
    runs = {
        "bound": bound,
        "h264": h264,
        "conditions": conditions,
        "hard": lambda: hard(seed),
        "speed": speed,
        "live": lambda: live(60 * minutes),
        "plain": lambda: plain(seed),
        "odd": lambda: odd(seed),
    }
    for part in parts or PARTS:
        runs[part]()


if __name__ == "__main__":
    main()
