"""Is anything lost where a command is killed? `python -m tests.benchmarks.kills --kills 50 --seed 1 [--only diagnose]`.

Four commands in turn: `analyze` of tables with one worker, `analyze` of recordings, `sweep` and `diagnose` with two.
Each is run once undisturbed, and its files are kept in mind. Then it is begun in an empty folder and killed
(SIGKILL, to the process that the user started, or to it and all its children) at a random moment of the time it had
taken, and begun again, until it comes to its end before the kill. After each kill every file that shows is one of the
undisturbed run, byte for byte (a record of a run may lack its later stages, and the fits of a diagnosis under way may
end in half a line), and at the end all are; only provenance.json, which names the command, is left out. Exits with 1
where that does not hold.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evaluator.workflow import calibrate
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.samples import copy_samples
from tests.benchmarks.batch import experiment_of
from tests.benchmarks.injected import PARTS
from tests.evaluator.diagnosis.hidden import write_hidden
from tests.evaluator.synthetic import circling_marks, write_experiment

ROOT = Path(__file__).parents[2]
OWN = "provenance.json"  # names the command
FITS = Outputs(Path()).diagnosis_fits.name
GOING_S = 2.0  # a child sees within half a second that its parent is gone; four times that on a busy machine
SWEEP = """format = 1
name = "kills"
robot = "barrel"
duration_s = 10.0
samples = 400
[fixed]
left_rpm = 33.3
right_rpm = 14.4
[grid]
"slip.lateral_friction" = { low = 0.2, high = 0.4, count = 5 }
[random]
"effect.plate-tilt.angle_deg" = { low = 0.0, high = 3.0 }
"""


@dataclass
class Command:
    """A command line, without the place of its results, and what it leaves undisturbed; counts of what was seen."""

    name: str
    arguments: tuple[str, ...]
    out: str = "out"
    whole: dict[str, bytes] = field(default_factory=dict)
    took_s: float = 0.0
    kills: int = 0
    ends: int = 0
    faults: list[str] = field(default_factory=list)

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Begin, or go on, in a folder."""
        line = [sys.executable, "-m", "evaluator", *self.arguments, "-o", str(folder / self.out), "-q"]
        quiet, path = subprocess.DEVNULL, {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(line, env=path, stdout=quiet, stderr=quiet, start_new_session=True)  # a group to kill


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder that shows, but for the one that names the command."""
    found = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    hidden = {name for name in found if any(part.startswith(".") for part in Path(name).parts)}
    return {name: path.read_bytes() for name, path in found.items() if name not in hidden and path.name != OWN}


def as_far_as_it_got(name: str, left: bytes, whole: bytes | None) -> bool:
    """Whether a file is that of the undisturbed run; a record of a run, too, that lacks the later of its stages.

    The fits of a diagnosis under way are lines, of which the last may be cut off, and the parts of a sweep under way
    are whole tables; the undisturbed run has neither left.
    """
    if PARTS in Path(name).parent.name:
        return whole is None and left.endswith(b"\n")
    if Path(name).name == FITS:
        return whole is None and all(map(is_json, left.splitlines()[1:-1]))
    if whole is None or left == whole or Path(name).parent.name != "records":
        return left == whole
    try:
        stages = json.loads(left)
    except ValueError:
        return False
    all_stages = json.loads(whole)
    return all(all_stages.get(stage) == content for stage, content in stages.items())


def is_json(line: bytes) -> bool:
    """Whether a line is JSON."""
    try:
        json.loads(line)
    except ValueError:
        return False
    return True


def commands(folder: Path) -> Iterator[Command]:
    """Write what the commands read."""
    runs = [(f"r0{k}", 14.4, 33.3, circling_marks(5.0 + k, seconds=3.0, seed=k)) for k in range(6)]
    tables = write_experiment(folder / "tables", runs)
    yield Command("analyze tables", ("analyze", str(tables), "--workers", "1"))
    samples = copy_samples(folder / "samples").parent
    calibrate(sorted(samples.glob("gauge-*.png")), samples / "gauge.toml").save(samples / "camera.json")
    yield Command("analyze recordings", ("analyze", str(experiment_of(samples, folder / "films", 4)), "--workers", "2"))
    (folder / "sweep.toml").write_text(SWEEP, encoding="utf-8")
    yield Command("sweep", ("sweep", str(folder / "sweep.toml"), "--workers", "2"), out="out/sweep.csv")
    hidden = write_hidden(folder / "hidden", {"scrub-torque": {"radius_mm": 0.1}}, seconds=3.0, exact=True)
    yield Command("diagnose", ("diagnose", str(hidden), "--workers", "2", "--seconds", "inf"))


def killed(command: Command, folder: Path, rng: np.random.Generator) -> None:
    """Let a command work for a random time and kill it; look at what it left."""
    everything = bool(rng.integers(2))
    with command.start(folder) as process:
        try:
            status: int | None = process.wait(float(rng.uniform(0.0, command.took_s)))
        except subprocess.TimeoutExpired:
            status = None
            (os.killpg if everything else os.kill)(process.pid, signal.SIGKILL)
    if status is None:
        command.kills += 1
        time.sleep(GOING_S)
    left = contents(folder)
    torn = [name for name in left if not as_far_as_it_got(name, left[name], command.whole.get(name))]
    if torn or status not in (None, 0):
        command.faults.append(f"kill {command.kills}, status {status}: {torn}")
    if status is not None:
        ended(command, folder)


def ended(command: Command, folder: Path) -> None:
    """Compare the files of a command that came to its end, and empty the folder."""
    command.ends += 1
    if (left := contents(folder)) != command.whole:
        command.faults.append(f"end {command.ends}: {sorted(set(left) ^ set(command.whole))}")
    shutil.rmtree(folder)
    folder.mkdir()


def main() -> None:
    """Kill, and print a line for every command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50, help="of all commands together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", metavar="WORDS", help='commands whose name begins so, as "diagnose"')
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder, lost = Path(name), 0
        every = [command for command in commands(folder) if command.name.startswith(given.only)]
        if not every:
            parser.error(f"--only {given.only}: no such command")
        for number, command in enumerate(every):
            out, began = folder / f"whole-{number}", time.monotonic()
            out.mkdir()
            command.start(out).wait()
            command.took_s, command.whole = time.monotonic() - began, contents(out)
            assert command.whole, f"{command.name} leaves nothing"
            place = folder / f"killed-{number}"
            place.mkdir()
            share = given.kills // len(every) + (number < given.kills % len(every))
            while command.kills < share:
                killed(command, place, rng)
            command.start(place).wait()
            ended(command, place)
            lost += len(command.faults)
            print(
                f"{command.name}: {command.took_s:.1f} s undisturbed, {len(command.whole)} files;"
                f" {command.kills} kills, {command.ends} times to the end, {len(command.faults)} faults",
                *command.faults[:3],
                flush=True,
            )
    raise SystemExit(lost > 0)


if __name__ == "__main__":
    main()
