"""Speed of the simulator beside its peers, at equal error, in one run: python -m tests.benchmarks.simulator_speed.

The run: 10 s, a step and a reversal at 5 s, 601 outputs, against a reference of scipy's LSODA at rtol 1e-12. Peers:
scipy's LSODA at rtol 1e-6 with a right-hand side in plain Python, and CyRK's with a compiled one.
Calls take turns, and the shortest time of each counts, since other work on the machine only ever adds; ratios are to
the first peer. "busy" is the ratio of processor times, which other work disturbs less.
"""

from __future__ import annotations

import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numba
import numpy as np

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.likelihood.run_data import RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from simulator.command import Command
from simulator.dynamics.equations import accelerations
from simulator.dynamics.model import compile_robot
from simulator.dynamics.wheel import fresh_contacts
from simulator.effects.catalogue import EFFECTS
from simulator.effects.entry import EffectEntry
from simulator.integrator.batch import integrate_one
from simulator.integrator.run_kernel import MOST_STEPS
from simulator.robot import Robot, load_robot
from simulator.simulation import simulate, simulate_batch
from simulator.steady import steady_map
from tests.benchmarks import cyrk_peer
from tests.simulator.reference import Rates, integrated, plain_rates

TIMES_S = np.linspace(0.0, 10.0, 601)
CASES = (("tire", 70.0, 100.0), ("barrel", 33.3, 14.4))
SEVERAL = {"plate-tilt": {"angle_deg": 2.0, "azimuth_deg": 40.0}, "magnet-imbalance": {"left_over_right": 1.1}}
SEVERAL |= {"tether-pull": {"x_mN": 0.1, "y_mN": 0.2}}
# Five steps from the robot's start a magnet catches the robot, whose wheels then chatter.
FAR = {"stray-magnet": {"x_mm": 20.0, "y_mm": 15.0}}
DIAGNOSED: list[list[str]] = [
    [],
    ["plate-tilt", "drive-speed-mismatch"],
    ["friction-gradient"],
    ["plate-tilt", "friction-gradient", "drive-speed-mismatch", "mass-offset"],
    ["speed-ripple"],
    ["axle-compliance", "motor-droop"],
]


def in_turns(calls: Mapping[str, Callable[[], object]], rounds: Mapping[str, int]) -> dict[str, tuple[float, float]]:
    """Shortest wall time and processor time of each call, s, after one to compile; each rounds times, in turns."""
    for call in calls.values():
        call()
    shortest = dict.fromkeys(calls, (np.inf, np.inf))
    for turn in range(max(rounds.values())):
        for name, call in calls.items():
            if turn % (max(rounds.values()) // rounds[name]) == 0:
                wall, busy = time.perf_counter(), time.process_time()
                call()
                taken = time.perf_counter() - wall, time.process_time() - busy
                shortest[name] = min(shortest[name][0], taken[0]), min(shortest[name][1], taken[1])
    return shortest


def best_of(call: Callable[[], object], times: int) -> float:
    """Shortest wall time of a call, s."""
    return in_turns({"": call}, {"": times})[""][0]


def numba_rates(robot: Robot, left: float, right: float) -> Rates:
    """Our kernel as a right-hand side for scipy."""
    model: Any = compile_robot(robot)[0]
    contacts = fresh_contacts()
    origin, rest = (0.0, 0.0, 1.0, 0.0, 0.0), float(model["rest_speed"])

    def rates(_time: float, y: Any) -> list[float]:
        cos, sin = np.cos(y[2]), np.sin(y[2])
        turning = accelerations(y[3], y[4], y[5], (left, right, 0.0, 0.0), origin, rest, model, contacts)
        return [cos * y[3] - sin * y[4], sin * y[3] + cos * y[4], y[5], *turning]

    return rates


def single_runs(name: str, left: float, right: float) -> None:
    """Table of one case."""
    robot = load_robot(name)
    halves = [(0.0, 5.0, plain_rates(robot, left, right)), (5.0, 10.0, plain_rates(robot, -left, -right))]
    faster = [(0.0, 5.0, numba_rates(robot, left, right)), (5.0, 10.0, numba_rates(robot, -left, -right))]
    truth = integrated(halves, TIMES_S, 1e-12, 1e-13)[:, :2]
    model, command = compile_robot(robot), Command.steps([(0.0, left, right), (5.0, -left, -right)])
    peer = "scipy LSODA, Python"
    calls: dict[str, Callable[[], Any]] = {
        peer: lambda: integrated(halves, TIMES_S, 1e-6, 1e-9),
        "scipy LSODA, our kernel": lambda: integrated(faster, TIMES_S, 1e-6, 1e-9),
    }
    if cyrk_peer.AVAILABLE:
        calls["CyRK LSODA, compiled"] = partial(cyrk_peer.lsoda(robot, left, right), TIMES_S, 1e-6, 1e-9)
    for tolerance in (1e-5, 3e-6, 1e-6, 1e-7, 1e-8):
        label = f"turnscope, tolerance {tolerance:.0e} mm"
        calls[label] = partial(simulate, model, command, TIMES_S, tolerance_mm=tolerance)
    taken = in_turns(calls, {label: 20 if label.startswith("scipy") else 400 for label in calls})
    print(f"\n{name}, {left:g} / {right:g} rpm, reversed at 5 s; largest error of the path in mm")
    for label, call in calls.items():
        found = call()
        path = found[:, :2] if isinstance(found, np.ndarray) else np.stack([found.x_mm, found.y_mm], axis=1)
        wall, busy = (base / own for base, own in zip(taken[peer], taken[label], strict=True))
        error = np.abs(path - truth).max()
        print(f"  {label:34s} {1e3 * taken[label][0]:9.3f} ms {wall:7.1f}x, busy {busy:7.1f}x   {error:.1e}")


def batches() -> None:
    """A batch of summaries at the tolerance whose error is the peer's: time on the wall, processor time, memory."""
    robot = load_robot("tire")
    model = compile_robot(robot)
    halves = [(0.0, 5.0, plain_rates(robot, 70.0, 100.0)), (5.0, 10.0, plain_rates(robot, -70.0, -100.0))]
    generator = np.random.default_rng(1)
    print("\nbatches on all cores, random commands with a reversal, summaries only")
    for count in (1000, 10_000):
        rpm = generator.uniform(60, 100, (count, 2))
        commands = [Command.steps([(0.0, a, b), (5.0, -a, -b)]) for a, b in rpm]
        call = partial(simulate_batch, model, commands, TIMES_S, summary=True, tolerance_mm=1e-6)
        peer = partial(integrated, halves, TIMES_S, 1e-6, 1e-9)
        taken = in_turns({"peer": peer, "batch": call}, {"peer": 30, "batch": 10})
        wall, busy = taken["batch"][0] / count, taken["batch"][1] / count / numba.get_num_threads()
        tracemalloc.start()
        call()
        peak = tracemalloc.get_traced_memory()[1] / count
        tracemalloc.stop()
        label = f"{count} runs, per run"
        print(f"  {label:34s} {1e3 * wall:9.4f} ms {taken['peer'][0] / wall:7.1f}x   {peak:.0f} bytes")
        print(f"  {'  processor time over threads':34s} {1e3 * busy:9.4f} ms {taken['peer'][1] / busy:7.1f}x")


def effects() -> None:
    """A run as fits see it: nominal, with several effects, and with each effect of the catalogue."""
    robot, command = load_robot("barrel"), Command.steps([(0.0, 33.3, 14.4), (5.0, -33.3, -14.4)])
    out = np.empty((len(TIMES_S), 6))

    def run_with(chosen: dict[str, dict[str, float]]) -> Callable[[], object]:
        entries = tuple(EffectEntry.model_validate({"id": id_, **values}) for id_, values in chosen.items())
        model = compile_robot(robot.model_copy(update={"effect": entries}))[0]
        return lambda: integrate_one(model, command.knots, np.zeros(6), TIMES_S, out, 1e-6, MOST_STEPS)

    calls = {"nominal": run_with({}), f"with {', '.join(SEVERAL)}": run_with(SEVERAL)}
    for id_, effect in EFFECTS.items():
        if effect.kind != "observation":
            sizes = {item.name: item.absent + 5 * item.step for item in effect.parameters}
            calls[id_] = run_with({id_: sizes | FAR.get(id_, {})})
    taken = in_turns(calls, dict.fromkeys(calls, 300))
    nominal = taken.pop("nominal")
    print(f"\nrun of 10 s for fits: nominal {1e3 * nominal[0]:.3f} ms")
    for label, (wall, _) in taken.items():
        print(f"  {label:22s} {wall / nominal[0]:5.2f}x nominal")


def diagnosis() -> None:
    """A task of the diagnosis: a run with motors on and off again, 540 frames, on one thread, with its marks."""
    robot, generator = load_robot("barrel"), np.random.default_rng(3)
    levels = [(33.3, 14.4), (-33.3, -14.4), (33.3, 28.5), (-30.0, -10.0), (14.0, 33.0), (20.0, 40.0), (50.0, 45.0)]
    frames = np.arange(540) / 60
    data = [RunData(f"r{k}", *item, 0.5, 8.0, frames, np.zeros((540, 4)), k) for k, item in enumerate(levels)]
    terms = named_terms(30.0, (10.0, 20.0, 33.0))
    print("\na task of the diagnosis on one thread")
    for ids in DIAGNOSED:
        tasks = []
        for number in range(210):
            values = {
                id_: tuple(item.absent + generator.normal(4.0, 0.05) * item.step for item in terms[id_].coordinates)
                for id_ in ids
            }
            own = (0.0, 0.0, 0.3, *(1e-3 * generator.standard_normal(3)).tolist())
            tasks.append(Task(number % len(data), own, {"slip.lateral_friction": 1e-3}, values))
        forward = Simulated([robot] * len(data), data, terms)
        taken = in_turns({"": partial(forward.marks, tasks)}, {"": 10})[""]
        print(f"  {', '.join(ids) or 'nominal':54s} {1e6 * taken[1] / len(tasks):7.0f} us of processor time")


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
        "import numpy as np\nfrom simulator.command import Command\nfrom simulator.simulation import simulate\n"
        "from simulator.robot import load_robot\nready = time.perf_counter()\n"
        "simulate(load_robot('barrel'), Command.constant(1.0, 2.0), np.linspace(0, 1, 5))\n"
        "print(f'{ready - start:.2f} s to import, {time.perf_counter() - ready:.2f} s for the first run')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    print(f"\na second process: {done.stdout.strip()}")


def main() -> None:
    """Print all tables."""
    for case in CASES:
        single_runs(*case)
    batches()
    effects()
    diagnosis()
    maps()
    fresh_process()


if __name__ == "__main__":
    main()
