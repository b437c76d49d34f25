"""Diagnoses on one core and on several: `python -m tests.benchmarks.diagnosis_speed --experiments 4 --workers 2`.

Draws experiments of the blind bank and diagnoses them through the command, one after another on one core and side by
side. Prints seconds, their ratio, and whether the answers are the same to the last digit.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.bank.draw import SIZES, draw


def main() -> None:
    """Draw, diagnose twice, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=4)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        for number in range(options.experiments):
            rng = np.random.default_rng([options.seed, number])
            draw(rng, "single", base / f"e{number}", sorted(SIZES)[number % len(SIZES)])
        files = [str(base / f"e{number}" / "experiment.toml") for number in range(options.experiments)]
        _timed(files[:1], base / "warm", 1)
        one, many = _timed(files, base / "one", 1), _timed(files, base / "many", options.workers)
        same = _answers(base / "one") == _answers(base / "many")
    print(
        f"{len(files)} experiments: {one:.0f} s on one core, {many:.0f} s with --workers {options.workers}: "
        f"{one / many:.2f} times as fast, answers {'identical' if same else 'DIFFERENT'}"
    )


def _timed(files: list[str], out: Path, workers: int) -> float:
    """Seconds of the command."""
    command = [sys.executable, "-m", "evaluator", "diagnose", *files, "-o", str(out), "--workers", str(workers), "-q"]
    began = time.perf_counter()
    subprocess.run(command, check=True)
    return time.perf_counter() - began


def _answers(out: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(out.rglob("diagnosis.json"))]


if __name__ == "__main__":
    main()
