"""Speed of the simulator beside its peers, at equal error, in one run: python -m tests.benchmarks.simulator_speed.

The run: 10 s, a step and a reversal at 5 s, 601 outputs, against a reference of scipy's LSODA at rtol 1e-12. Peer:
scipy LSODA at rtol 1e-6 with a right-hand side in plain Python.
Times are the best of several, since other work on the machine only ever adds; ratios are to the peer.
"""

from __future__ import annotations

import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from simulator.command import Command
from simulator.dynamics import accelerations
from simulator.effects.catalogue import EFFECTS
from simulator.integrate import simulate, simulate_batch
from simulator.many import Trials
from simulator.model import compile_robot
from simulator.robot import Effect, Robot, load_robot
from simulator.steady import steady_map
from tests.simulator.reference import Rates, integrated, plain_rates

TIMES_S = np.linspace(0.0, 10.0, 601)
CASES = (("tire", 70.0, 100.0), ("barrel", 33.3, 14.4))
SEVERAL = {"plate-tilt": {"angle_deg": 2.0, "azimuth_deg": 40.0}, "magnet-imbalance": {"left_over_right": 1.1}}
SEVERAL |= {"tether-pull": {"x_mN": 0.1, "y_mN": 0.2}}


def best_of(call: Callable[[], object], times: int) -> float:
    """Shortest wall time of a call, s, after one call to compile."""
    call()
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return min(taken)


def numba_rates(robot: Robot, left: float, right: float) -> Rates:
    """Our kernel as a right-hand side for scipy."""
    model: Any = compile_robot(robot)[0]
    origin, rest = (0.0, 0.0, 1.0, 0.0, 0.0), float(model["rest_speed"])

    def rates(_time: float, y: Any) -> list[float]:
        cos, sin = np.cos(y[2]), np.sin(y[2])
        turning = accelerations(y[3], y[4], y[5], (left, right, 0.0, 0.0), origin, rest, model)
        return [cos * y[3] - sin * y[4], sin * y[3] + cos * y[4], y[5], *turning]

    return rates


def single_runs(name: str, left: float, right: float) -> float:
    """Table of one case; returns the time of the peer."""
    robot = load_robot(name)
    halves = [(0.0, 5.0, plain_rates(robot, left, right)), (5.0, 10.0, plain_rates(robot, -left, -right))]
    truth = integrated(halves, TIMES_S, 1e-12, 1e-13)[:, :2]
    peer_error = np.abs(integrated(halves, TIMES_S, 1e-6, 1e-9)[:, :2] - truth).max()
    peer = best_of(lambda: integrated(halves, TIMES_S, 1e-6, 1e-9), 7)
    print(f"\n{name}, {left:g} / {right:g} rpm, reversed at 5 s; largest error of the path in mm")
    print(f"  {'scipy LSODA, Python':34s} {1e3 * peer:9.3f} ms     1.0x   {peer_error:.1e}")
    faster = [(0.0, 5.0, numba_rates(robot, left, right)), (5.0, 10.0, numba_rates(robot, -left, -right))]
    taken = best_of(lambda: integrated(faster, TIMES_S, 1e-6, 1e-9), 7)
    print(f"  {'scipy LSODA, our kernel':34s} {1e3 * taken:9.3f} ms {peer / taken:7.1f}x   {peer_error:.1e}")
    model, command = compile_robot(robot), Command.steps([(0.0, left, right), (5.0, -left, -right)])
    for tolerance in (1e-5, 1e-6, 1e-7, 1e-8):
        run = simulate(model, command, TIMES_S, tolerance_mm=tolerance)
        error = np.abs(np.stack([run.x_mm, run.y_mm], axis=1) - truth).max()
        taken = best_of(partial(simulate, model, command, TIMES_S, tolerance_mm=tolerance), 300)
        label = f"turnscope, tolerance {tolerance:.0e} mm"
        print(f"  {label:34s} {1e3 * taken:9.3f} ms {peer / taken:7.1f}x   {error:.1e}")
    return peer


def batches(peer: float) -> None:
    """A batch of summaries at the tolerance whose error is the peer's: time on the wall, processor time, memory."""
    model = compile_robot(load_robot("tire"))
    generator = np.random.default_rng(1)
    print("\nbatches on all cores, random commands with a reversal, summaries only")
    for count in (1000, 10_000):
        rpm = generator.uniform(60, 100, (count, 2))
        commands = [Command.steps([(0.0, a, b), (5.0, -a, -b)]) for a, b in rpm]
        call = partial(simulate_batch, model, commands, TIMES_S, summary=True, tolerance_mm=1e-6)
        taken = best_of(call, 5) / count
        start = time.process_time()
        call()
        busy = (time.process_time() - start) / count / numba.get_num_threads()
        tracemalloc.start()
        call()
        peak = tracemalloc.get_traced_memory()[1] / count
        tracemalloc.stop()
        label = f"{count} runs, per run"
        print(f"  {label:34s} {1e3 * taken:9.4f} ms {peer / taken:7.1f}x   {peak:.0f} bytes")
        print(f"  {'  processor time over threads':34s} {1e3 * busy:9.4f} ms {peer / busy:7.1f}x")


def effects() -> None:
    """A run as fits see it: nominal, with several effects, and with each effect of the catalogue."""
    numba.set_num_threads(1)  # one run needs no second thread, and waiting for one would be all that is measured
    robot = load_robot("barrel")
    trials = Trials([Command.steps([(0.0, 33.3, 14.4), (5.0, -33.3, -14.4)])], [TIMES_S])

    def taken(chosen: dict[str, dict[str, float]]) -> float:
        entries = tuple(Effect.model_validate({"id": id_, **values}) for id_, values in chosen.items())
        model = compile_robot(robot.model_copy(update={"effect": entries}))
        plan = trials.plan(model, np.zeros(6), 1e-6)
        return best_of(lambda: trials.states(model, np.zeros(6), plan), 200)

    nominal = taken({})
    several = taken(SEVERAL)
    print(f"\nreplayed run of 10 s for fits: nominal {1e3 * nominal:.3f} ms")
    print(f"  with {', '.join(SEVERAL)}: {several / nominal:.2f}x nominal")
    for id_, effect in EFFECTS.items():
        if effect.kind != "observation":
            sizes = {item.name: item.neutral + 5 * item.step for item in effect.parameters}
            print(f"  {id_:22s} {taken({id_: sizes}) / nominal:5.2f}x nominal")


def maps() -> None:
    """A map of steady turns."""
    speeds, ratios = np.arange(20.0, 51.0, 5.0), np.linspace(1.0, 0.0, 50)
    for name in ("tire", "barrel"):
        robot = load_robot(name)
        taken = best_of(partial(steady_map, robot, speeds, ratios), 5)
        print(f"\nsteady turns, {name}, 7 speeds x 50 ratios: {taken:.4f} s (asked: under 0.1 s)")


def fresh_process() -> None:
    """First run of a second process, which must not compile."""
    script = (
        "import time; start = time.perf_counter()\n"
        "import numpy as np\nfrom simulator.command import Command\nfrom simulator.integrate import simulate\n"
        "from simulator.robot import load_robot\nready = time.perf_counter()\n"
        "simulate(load_robot('barrel'), Command.constant(1.0, 2.0), np.linspace(0, 1, 5))\n"
        "print(f'{ready - start:.2f} s to import, {time.perf_counter() - ready:.2f} s for the first run')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    print(f"\na second process: {done.stdout.strip()}")


def main() -> None:
    """Print all tables."""
    peers = [single_runs(*case) for case in CASES]
    batches(peers[0])
    effects()
    maps()
    fresh_process()


if __name__ == "__main__":
    main()
