"""Random runs at the default tolerance against a thousandth of it: a run that is off must say so.

python -m tests.benchmarks.converged --runs 10000 [--seed 1] [--show 5]

A run draws a wheel type, none to two effects of the catalogue, and one to three commands. It agrees where the paths
stay within ALLOWED_MM plus ALLOWED_SHARE of the way; else it must be refused, or say so (Run.is_converged,
Run.is_by_chance).
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from tests.simulator.random_runs import ALLOWED_MM, ALLOWED_SHARE, disagreement_mm, drawn


def main() -> None:
    """Compare, and exit with 1 where a run is off without saying so."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=10, help="wrong runs to print")
    given = parser.parse_args()
    began, wrong, flagged, unknown, apart = time.perf_counter(), 0, 0, 0, [0.0]
    for number in range(given.runs):
        run = drawn(np.random.default_rng([given.seed, number]))
        off, way, says_so = disagreement_mm(run)
        flagged += says_so
        unknown += bool(np.isnan(off))
        if not says_so and not np.isnan(off):
            apart.append(off)
            if off > ALLOWED_MM + ALLOWED_SHARE * way:
                wrong += 1
                if wrong <= given.show:
                    effects = [(entry.id, entry.given) for entry in run.robot.effect]
                    print(
                        f"run {number}: {off:.4f} mm of {way:.1f} mm: {run.robot.name}, {effects}, {run.command}",
                        flush=True,
                    )
    print(
        f"{given.runs} runs with seed {given.seed}: {wrong} wrong without saying so, {flagged} say that they may be,"
        f" {unknown} cannot be followed more closely;"
        f" of the others the median is off by {np.median(apart):.1e} mm, 99.9 % by less than"
        f" {np.quantile(apart, 0.999):.1e} mm, the worst by {max(apart):.1e} mm; {time.perf_counter() - began:.0f} s"
    )
    raise SystemExit(wrong > 0)


if __name__ == "__main__":
    main()
