"""Mutation tests: one small change at a time is made to the code, and the tests that reach it are run; do they notice?

Every change is made in a copy of the project, so that the project itself is never touched. The tests of the unchanged
copy have to pass first; there it is noted what each of them calls and how long it takes, and a change is then tried on
those that call the changed function, the cheapest first, until one fails.

    python -m tests.benchmarks.mutation evaluator/pose.py --tests tests/evaluator/test_pose.py --sample 30 --seed 1
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.mutation.mutants import ROOT, Mutant, mutants
from tests.benchmarks.mutation.reach import Reach, Unit, tests_of, units
from tests.benchmarks.mutation.runs import dependents, observed, pass_of, preload, prepare


def main() -> int:
    """Run a sample of mutants; exit status 1 where fewer are noticed than asked for."""
    said = _arguments()
    prepare(jit=not said.no_jit)
    paths = [
        file.relative_to(ROOT)
        for path in said.paths
        for file in (sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path])
    ]
    everything = [
        mutant for path in paths for mutant in mutants(path) if not said.constants or mutant.is_constant_of_module
    ]
    if said.list:
        for mutant in everything:
            print(f"{mutant.path}:{mutant.line}  {mutant.change}")
        return 0
    chosen = random.Random(said.seed).sample(everything, min(said.sample, len(everything)))  # noqa: S311
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve() / "project"
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "out"))  # compiled kernels come along
        preload(folder, said.tests)
        reach = observed(said.tests, frozenset().union(*map(dependents, paths)), folder)
        if reach is None:
            print("the tests do not pass on the unchanged code")
            return 2
        for test in [test for test, time_s in reach.time_s.items() if time_s > said.longest_s]:
            print(f"left out: {test}, {reach.time_s[test]:.1f} s")
            del reach.called[test]
        code = units(folder)
        survived = 0
        for number, mutant in enumerate(chosen, 1):
            outcome = _tried(mutant, folder, reach, code, said.limit_s)
            survived += outcome.startswith("survived")
            if said.verbose or outcome.startswith("survived"):
                print(f"{number}/{len(chosen)}  {mutant.path}:{mutant.line}  {mutant.change}  {outcome}", flush=True)
    share = 1 - survived / len(chosen)
    print(f"{len(chosen)} of {len(everything)} mutants (seed {said.seed}): {100 * share:.0f} % noticed")
    return 0 if share >= said.wanted else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, help="files or folders to change, from the project's root")
    parser.add_argument("--tests", nargs="+", default=["tests"], help="tests to run, from the project's root")
    parser.add_argument("--sample", type=int, default=60, help="mutants to try (default 60)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument("--constants", action="store_true", help="only double the numbers that modules name")
    parser.add_argument("--list", action="store_true", help="only list the changes")
    parser.add_argument("--limit-s", type=float, default=120, help="processor time of a mutant (default 120)")
    parser.add_argument(
        "--longest-s", type=float, default=10, help="leave out tests of more processor time (default 10)"
    )
    parser.add_argument("--no-jit", action="store_true", help="without numba's compiler: faster where loops are short")
    parser.add_argument("--wanted", type=float, default=0.9, help="share to be noticed (default 0.9)")
    parser.add_argument("--verbose", action="store_true", help="name the mutants that are noticed as well")
    return parser.parse_args()


def _tried(mutant: Mutant, folder: Path, reach: Reach, code: list[Unit], limit_s: float) -> str:
    """Outcome of one mutant; what takes three times the processor time of the unchanged tests is noticed."""
    chosen = tests_of(mutant.path, mutant.line, code, reach.called, in_process=False)
    if not chosen:
        return "survived: no test reaches it"
    usual_s = sum(reach.time_s[test] for test in chosen)
    file = folder / mutant.path
    shutil.copy2(file, original := folder.parent / "original.py")
    file.write_text(mutant.text(), encoding="utf-8")
    passed = pass_of(chosen, reach, dependents(mutant.path), min(3 * usual_s + 20, limit_s))
    shutil.copy2(original, file)  # with its time: a kernel is compiled anew where a source is younger
    if passed is None:
        return f"out of time ({usual_s:.1f} s unchanged)"
    return f"survived {len(chosen)} tests of {usual_s:.1f} s" if passed else "noticed"


if __name__ == "__main__":
    sys.exit(main())
