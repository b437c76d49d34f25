"""First demo after installation, with nothing compiled, and a later one: processor time, and time on an idle machine.

Other programs do not change the estimate of the wall time much: it is the processor time of each second over the number
of threads of turnscope that could run, at most as many as there are cores. Linux only.

python -m tests.benchmarks.first_minute [--cores 2] [--source FOLDER of another version]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
LOOKED_S = 0.2  # between two looks at the processes
SESSION, STATE, USER, SYSTEM = 3, 0, 11, 12  # fields of /proc/PID/stat after the name of the program
# Not "-m": see evaluator.cli.guard.
COMMAND = [sys.executable, "-P", "-c", "import sys; sys.argv[0] = 'turnscope'; from evaluator.cli import main; main()"]


def main() -> None:
    """Run the demo twice, and print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cores", type=int, default=2, help="of the idle machine")
    parser.add_argument("--source", type=Path, default=ROOT, help="folder with the packages")
    said = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for run in ("cold", "warm"):
            used_s, idle_s, wall_s = measured(said.source.resolve(), Path(name), run, said.cores)
            load = os.getloadavg()[0]
            idle = f"{idle_s:.1f} s on {said.cores} idle cores"
            print(f"{run}: {used_s:.1f} s CPU, {idle}; now {wall_s:.1f} s, load {load:.1f}")


def measured(source: Path, folder: Path, run: str, cores: int) -> tuple[float, float, float]:
    """Processor time of all processes of a demo, its wall time on idle cores, and its wall time now, in seconds."""
    environment = {**os.environ, "PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    line = [*COMMAND, "demo", "-q", "-o", str(folder / run)]
    begun, used, before = time.monotonic(), defaultdict[int, float](float), dict[int, float]()
    could_run, looks = defaultdict[int, int](int), defaultdict[int, int](int)
    demo = subprocess.Popen(line, env=environment, start_new_session=True)
    while demo.poll() is None:
        time.sleep(LOOKED_S)
        second = int(time.monotonic() - begun)
        looks[second] += 1
        for process, (threads, cpu_s) in processes_of(demo.pid).items():
            could_run[second] += threads
            used[second] += cpu_s - before.get(process, 0.0)
            before[process] = cpu_s
    if demo.returncode:
        sys.exit(f"the demo ended with status {demo.returncode}")
    at_once = {second: min(max(could_run[second] / looks[second], 1.0), cores) for second in looks}
    return sum(used.values()), sum(used[k] / at_once[k] for k in looks), time.monotonic() - begun


def processes_of(session: int) -> dict[int, tuple[int, float]]:
    """Threads that could run, and processor time in s, of each process of a session."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = _stat(folder)
            if int(fields[SESSION]) == session:
                threads = sum(_stat(thread)[STATE] == "R" for thread in (folder / "task").iterdir())
                ticks = int(fields[USER]) + int(fields[SYSTEM])
                found[int(folder.name)] = threads, ticks / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError):  # it has ended
            continue
    return found


def _stat(folder: Path) -> list[str]:
    return (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()


if __name__ == "__main__":
    main()
