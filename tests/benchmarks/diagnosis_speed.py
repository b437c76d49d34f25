"""Time of diagnoses: on one core and on several, and of two states of the code in turn.

`python -m tests.benchmarks.diagnosis_speed cores --experiments 4 --workers 2` draws experiments of the blind bank and
diagnoses them through the command, one after another on one core and side by side. Prints seconds, their ratio, and
whether the answers are the same to the last digit.

`python -m tests.benchmarks.diagnosis_speed before CHECKOUT EXPERIMENT.toml …` diagnoses each experiment with the code
in another checkout and with this one, each once before (kernels are compiled then), in turn. Prints processor and wall
time and both answers. Experiments: tests.benchmarks.laboratory with --keep leaves them.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.bank.draw import SIZES, draw

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Compare cores, or two states of the code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    tasks = parser.add_subparsers(dest="task", required=True)
    cores = tasks.add_parser("cores", help="one core and several")
    cores.add_argument("--experiments", type=int, default=4)
    cores.add_argument("--workers", type=int, default=2)
    cores.add_argument("--seed", type=int, default=0)
    before = tasks.add_parser("before", help="another checkout and this one")
    before.add_argument("checkout", type=Path)
    before.add_argument("experiments", type=Path, nargs="+")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.task == "cores":
            compare_cores(options.experiments, options.workers, options.seed, Path(folder))
        else:
            compare_code(options.checkout, options.experiments, Path(folder))


def compare_cores(experiments: int, workers: int, seed: int, base: Path) -> None:
    """Draw, diagnose on one core and on several, compare."""
    for number in range(experiments):
        rng = np.random.default_rng([seed, number])
        draw(rng, "single", base / f"e{number}", sorted(SIZES)[number % len(SIZES)])
    files = [base / f"e{number}" / "experiment.toml" for number in range(experiments)]
    _timed(files[:1], base / "warm", 1)
    (one, _), (many, _) = _timed(files, base / "one", 1), _timed(files, base / "many", workers)
    same = _answers(base / "one") == _answers(base / "many")
    print(
        f"{len(files)} experiments: {one:.0f} s on one core, {many:.0f} s with --workers {workers}: "
        f"{one / many:.2f} times as fast, answers {'identical' if same else 'DIFFERENT'}"
    )


def compare_code(checkout: Path, experiments: list[Path], base: Path) -> None:
    """Diagnose each experiment with both states of the code, compare."""
    print("experiment | s of processor time, before, now | wall s, before, now | answer before | now", flush=True)
    totals = np.zeros(4)
    for number, file in enumerate(experiments):
        times: list[float] = []
        said = []
        for name, code in (("before", checkout), ("now", ROOT)):
            out = base / f"{name}{number}"
            times += reversed(_timed([file.resolve()], out, 1, code))
            content = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
            effects = [effect.get("id", "no name") for effect in content["effects"]]
            said.append(" ".join([content["verdict"], *effects]))
        totals += times
        _row(file.parent.name, times, said)
    _row("all", totals.tolist(), ["", ""])


def _row(name: str, times: list[float], said: list[str]) -> None:
    before, wall_before, now, wall_now = times
    print(
        f"{name} | {before:.1f} {now:.1f} ({now / before:.2f}) | {wall_before:.0f} {wall_now:.0f} | {' | '.join(said)}",
        flush=True,
    )


def _timed(files: list[Path], out: Path, workers: int, code: Path = ROOT) -> tuple[float, float]:
    """Wall and processor seconds of the command."""
    options = [*map(str, files), "-o", str(out), "--workers", str(workers), "-q"]
    command = [sys.executable, "-m", "evaluator", "diagnose", *options]
    # PYTHONPATH: the command starts processes of its own, which would find the package that is installed
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(code.resolve())}
    began, used = time.perf_counter(), _used()
    subprocess.run(command, check=True, cwd=code, env=environment)
    return time.perf_counter() - began, _used() - used


def _used() -> float:
    """Processor seconds of all processes that this one waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _answers(out: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(out.rglob("diagnosis.json"))]


if __name__ == "__main__":
    main()
