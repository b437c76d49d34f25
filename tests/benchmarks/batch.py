"""How fast is a batch? `python -m tests.benchmarks.batch --recordings 200`.

Copies of the shipped samples (640×480, 60 frames/s, 6 to 12 s) stand for the recordings: nothing is shared between
runs, so a copy costs what any recording costs. Prints, measured in one go: what the first recording after installation
costs (kernels are compiled), one worker beside two, all stages up to the report from cold, the same command again, and
what is done after a kill. Seconds on the wall depend on what else the machine does; CPU seconds of one worker less so.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from evaluator.settings import load_experiment
from evaluator.workflow import calibrate
from evaluator.workflow.samples import copy_samples

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=200, help="of the cold run")
    parser.add_argument("--beside", type=int, default=100, help="recordings for one worker beside two")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = copy_samples(folder / "samples").parent
        calibrate(sorted(samples.glob("gauge-*.png")), samples / "gauge.toml").save(samples / "camera.json")
        many = experiment_of(samples, folder / "many", options.recordings)
        few = experiment_of(samples, folder / "few", options.beside)
        first = experiment_of(samples, folder / "first", 1)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation has its byte code
        fresh = {"NUMBA_CACHE_DIR": str(folder / "kernels")}
        show("first recording ever, to the report", *timed("report", first, "-o", folder / "first-out", more=fresh))
        show("one recording, to the report", *timed("report", first, "-o", folder / "second-out"))
        one = timed("analyze", few, "-o", folder / "one", "--workers", 1)
        show(f"{options.beside} recordings, 1 worker", *one, f"{one[1] / options.beside:.3f} CPU s each")
        two = timed("analyze", few, "-o", folder / "two", "--workers", 2)
        same = equal(folder / "one", folder / "two")
        show(f"{options.beside} recordings, 2 workers", two[0], None, f"{one[0] / two[0]:.2f}×, results {same}")
        cold = timed("report", many, "-o", folder / "out", "--workers", 2)
        each = f"{cold[0] / options.recordings:.3f} s each, from cold"
        show(f"{options.recordings} recordings to the report, 2 workers", cold[0], None, each)
        show(f"{options.recordings} recordings again", *timed("report", many, "-o", folder / "out"), "all reused")
        print(f"report page {(folder / 'out' / 'report.html').stat().st_size / 1e6:.2f} MB")
        killed(few, folder / "killed", after_s=two[0] / 2)
        rest = timed("analyze", few, "-o", folder / "killed", "--workers", 2)
        show(
            f"{options.beside} after a kill half way",
            rest[0],
            None,
            f"results {equal(folder / 'two', folder / 'killed')}",
        )


def experiment_of(samples: Path, folder: Path, count: int) -> Path:
    """An experiment over count copies of the samples."""
    runs = load_experiment(samples / "experiment.toml").run
    folder.mkdir()
    shutil.copy(samples / "camera.json", folder)
    lines = ['format = 1\nname = "batch"\nrobot = "barrel"\ncamera = "camera.json"\n']
    for number in range(count):
        run = runs[number % len(runs)]
        assert run.video is not None
        name = f"r{number:03d}"
        shutil.copy(run.video, folder / f"{name}.mp4")
        lines.append(
            f'[[run]]\nid = "{name}"\nleft_rpm = {run.left_rpm}\nright_rpm = {run.right_rpm}\n'
            f'start_s = {run.start_s}\nvideo = "{name}.mp4"\n'
        )
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def command(*arguments: object) -> list[str]:
    """A turnscope command line."""
    return [sys.executable, "-m", "evaluator", *map(str, arguments), "--quiet"]


def timed(*arguments: object, more: dict[str, str] | None = None) -> tuple[float, float]:
    """Seconds on the wall and of the CPU for a command; workers of its own do not count in the latter."""
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command(*arguments), cwd=ROOT, check=True, env={**os.environ, **(more or {})})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, cpu


def show(what: str, wall: float, cpu: float | None, remark: str = "") -> None:
    """One line of the table."""
    used = f"{cpu:7.1f} CPU s" if cpu is not None else " " * 13
    print(f"{what:40} {wall:7.1f} s {used}   {remark}".rstrip(), flush=True)


def killed(experiment: Path, out: Path, after_s: float) -> None:
    """Start an analysis and kill it."""
    process = subprocess.Popen(command("analyze", experiment, "-o", out, "--workers", 2), cwd=ROOT)
    time.sleep(after_s)
    process.send_signal(signal.SIGKILL)
    process.wait()


def equal(first: Path, second: Path) -> str:
    """Whether two output folders hold the same tables, in words."""
    names = sorted(path.relative_to(first) for path in first.rglob("*.csv"))
    same = all((first / name).read_bytes() == (second / name).read_bytes() for name in names)
    return "identical" if names and same else "DIFFERENT"


if __name__ == "__main__":
    main()
