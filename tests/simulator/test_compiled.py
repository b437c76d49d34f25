"""Kernels are compiled once: for one kind of arguments, by one process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from simulator.command import Command
from simulator.robot import load_robot
from simulator.simulation import simulate

ROOT = Path(__file__).parents[2]
KERNEL = """
from simulator.compilation import compiled

@compiled()
def part(x):
    return x * x + 1.0

@compiled()
def whole(x):
    return part(x) + part(2.0 * x)

if __name__ == "__main__":
    import own_kernel
    own_kernel.whole(3.0)
    print(sum(own_kernel.whole.stats.cache_misses.values()))
"""
ONE_KIND = """
import numpy as np
from simulator.command import Command
from simulator.simulation import simulate, simulate_batch
from simulator.integrator.batch import integrate_some
from simulator.robot import load_robot
from simulator.steady import steady_turn
from simulator.wheel_states import _fill

robot, command, times = load_robot("barrel"), Command.constant(20.0, 30.0), np.linspace(0, 1, 5)
steady_turn(robot, 20.0, 30.0)
simulate(robot, command, times).to_table()
simulate_batch([robot], [command] * 2, times, summary=True)
print([len(kernel.signatures) for kernel in (integrate_some, _fill)])
print(sum(integrate_some.stats.cache_misses.values()), sum(integrate_some.stats.cache_hits.values()))
"""


def test_processes_that_start_together_share_the_work_of_compiling(tmp_path: Path) -> None:
    (tmp_path / "own_kernel.py").write_text(KERNEL, encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), str(ROOT)])
    around = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}
    line = [sys.executable, str(tmp_path / "own_kernel.py")]
    started = [subprocess.Popen(line, env=around, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    compiled = sorted(int(process.communicate(timeout=100)[0]) for process in started)
    assert compiled == [0, 0, 1]


def test_kernels_of_runs_are_compiled_for_one_kind_of_arguments_and_not_again_by_a_second_process() -> None:
    simulate(load_robot("barrel"), Command.constant(1.0, 2.0), np.linspace(0, 1, 5))  # the first
    done = subprocess.run([sys.executable, "-c", ONE_KIND], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[1, 1]", "0 1"]
