"""How fast is a batch? `python -m tests.benchmarks.batch --recordings 200`.

Copies of the shipped samples (640×480, 60 frames/s) stand for the recordings: nothing is shared between
runs, so a copy costs what any recording costs. Prints, measured in one go: all stages up to the report from cold, one
worker beside two, the same command again, and what is done after a kill.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from evaluator.cli.demo import calibrate_samples
from evaluator.settings import load_experiment
from evaluator.workflow.samples import copy_samples

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=200, help="of the cold run")
    parser.add_argument("--beside", type=int, default=40, help="recordings for one worker beside two")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = copy_samples(folder / "samples").parent
        calibrate_samples(samples)
        many = experiment_of(samples, folder / "many", options.recordings)
        few = experiment_of(samples, folder / "few", options.beside)
        one, _ = timed("analyze", few, "-o", folder / "one", "--workers", 1)
        two, _ = timed("analyze", few, "-o", folder / "two", "--workers", 2)
        same = equal(folder / "one", folder / "two")
        print(f"{options.beside} recordings, 1 worker     {one:7.1f} s")
        print(f"{options.beside} recordings, 2 workers    {two:7.1f} s   {one / two:.2f}×, results {same}")
        cold, _ = timed("report", many, "-o", folder / "out", "--workers", 2)
        each = cold / options.recordings
        print(f"{options.recordings} recordings to the report {cold:7.1f} s   {each:.3f} s each, cold")
        again, _ = timed("report", many, "-o", folder / "out", "--workers", 2)
        print(f"{options.recordings} recordings again         {again:7.1f} s   all reused")
        size = (folder / "out" / "report.html").stat().st_size / 1e6
        print(f"report page                {size:7.2f} MB")
        killed(few, folder / "killed", after_s=two / 2)
        rest, _ = timed("analyze", few, "-o", folder / "killed", "--workers", 2)
        same = equal(folder / "two", folder / "killed")
        print(f"{options.beside} after a kill half way    {rest:7.1f} s   results {same}")


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


def timed(*arguments: object) -> tuple[float, int]:
    """Seconds and exit status of a command."""
    began = time.perf_counter()
    status = subprocess.run(command(*arguments), cwd=ROOT, check=True).returncode
    return time.perf_counter() - began, status


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
