"""Mutants tried in forks of one session of pytest: a changed module is executed again in its own namespace.

Nothing is imported or collected anew, so that a mutant costs as much as the tests that notice it: for the front ends,
whose tests take milliseconds, a tenth of what a run of `python -m tests.benchmarks.mutation` takes. Of what a module
computes while it is imported, only names that other modules have taken over directly get their new values. A test that
fails when the unchanged text of a module is executed again says nothing of its changes, and does not take part.

    python -m tests.benchmarks.mutation.quick evaluator/cli --tests tests/evaluator/cli --sample 30 --seed 1
"""

from __future__ import annotations

import argparse
import ast
import gc
import importlib
import inspect
import math
import os
import random
import resource
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

from tests.benchmarks.mutation.mutants import ROOT, Mutant, mutants
from tests.benchmarks.mutation.reach import OURS, Place, Reach, Unit, tests_of, units
from tests.benchmarks.mutation.runs import ended, imported


class Trial:
    """A plugin of pytest that runs all tests once, and then those that reach a mutant, for each mutant in a fork."""

    def __init__(self, chosen: Sequence[Mutant], reach: Reach, longest_s: float) -> None:
        """chosen: mutants to try; reach: a plugin of the same session, which notes what each test calls."""
        self.chosen, self.reach, self.longest_s = chosen, reach, longest_s
        self.failed, self.tried, self.survived = False, 0, 0
        self.fit: dict[tuple[Path, str], bool] = {}
        self.file_s: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note that a test has failed."""
        self.failed |= report.failed

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the unchanged tests, then try the mutants."""
        self._run(session.items)
        if self.failed:
            print("the tests do not pass on the unchanged code")
            return True
        session.config.pluginmanager.unregister(self.reach)
        for test in [test for test, time_s in self.reach.time_s.items() if time_s > self.longest_s]:
            print(f"left out: {test}, {self.reach.time_s[test]:.1f} s")
            self.reach.called.pop(test, None)
        for test, time_s in self.reach.time_s.items():
            file = test.partition("::")[0]
            self.file_s[file] = self.file_s.get(file, 0.0) + time_s
        code = units(ROOT)
        for other in _ours():  # read here, once, and not in every fork
            _imported(Path(str(other.__file__)))
        gc.freeze()
        called = self.reach.called
        reached = [_reached(mutant, code, called) for mutant in self.chosen]
        for number, (mutant, ids) in enumerate(zip(self.chosen, reached, strict=True), 1):
            tests = sorted((item for item in session.items if item.nodeid in ids), key=self._cost)
            outcome = self._outcome(mutant, tests)
            self.tried += not outcome.startswith("not tried")
            self.survived += outcome.startswith("survived")
            print(f"{number}/{len(self.chosen)}  {mutant.path}:{mutant.line}  {mutant.change}  {outcome}", flush=True)
        return True

    def _outcome(self, mutant: Mutant, tests: Sequence[pytest.Item]) -> str:
        """What becomes of a mutant: a test that fails without a change as well does not notice it."""
        able = list(tests)
        while able:
            failed = self._failing(mutant.path, mutant.text(), able)
            if failed is None:
                return f"survived {len(able)} tests"
            if self._is_fit(mutant.path, able[failed]):
                return f"noticed by {able[failed].nodeid.rpartition('/')[2]}"
            del able[failed]
        return "not tried: no test passes on the unchanged module, executed again" if tests else "survived 0 tests"

    def _is_fit(self, path: Path, test: pytest.Item) -> bool:
        """Whether a test passes where a module is executed again as it is."""
        if (path, test.nodeid) not in self.fit:
            self.fit[path, test.nodeid] = self._failing(path, unchanged(path), [test]) is None
        return self.fit[path, test.nodeid]

    def _cost(self, item: pytest.Item) -> tuple[float, str, float]:
        """Cheap files first; tests of a file stay together, for what they share."""
        file = item.nodeid.partition("::")[0]
        return self.file_s[file], file, self.reach.time_s[item.nodeid]

    def _run(self, tests: Sequence[pytest.Item], note: Callable[[int], None] = lambda _: None) -> None:
        """Run tests until one fails; note: called with the place of each beforehand."""
        for place, (item, following) in enumerate(zip(tests, [*tests[1:], None], strict=True)):
            note(place)
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self.failed:
                return

    def _failing(self, path: Path, text: str, tests: Sequence[pytest.Item]) -> int | None:
        """Place of the first test that fails, or takes far too long, in a fork where a module has another text."""
        with tempfile.TemporaryFile("w+") as found:

            def run() -> None:
                change(path, text)
                self._run(tests, lambda place: print(place, file=found, flush=True))
                if self.failed:
                    raise AssertionError

            if in_fork(run, 3 * self._usual_s(tests) + 20) == 0:
                return None
            found.seek(0)
            return int((found.read().split() or ["0"])[-1])

    def _usual_s(self, tests: Sequence[pytest.Item]) -> float:
        return sum(self.reach.time_s[item.nodeid] for item in tests)


def _reached(mutant: Mutant, code: list[Unit], called: dict[str, set[Place]]) -> frozenset[str]:
    """Tests that reach a mutant: those of what is declared for another module to gather reach it by that module."""
    found = tests_of(mutant.path, mutant.line, code, called, in_process=True)
    here = [unit for unit in code if unit.path == str(mutant.path) and unit.first <= mutant.line <= unit.last]
    gathers = "" if any(unit.function for unit in here) else str(GATHERED.get(mutant.path.parent.as_posix()))
    wait = [unit for unit in code if unit.path == gathers and "BUILT_IN" in unit.gives]
    return found.union(*(tests_of(Path(gathers), unit.first, code, called, in_process=True) for unit in wait))


def in_fork(run: Callable[[], None], limit_s: float) -> int:
    """Exit status of a fork that runs a function without a word, in a limited processor time; 0 if it returns.

    A lock that another thread held at the fork is never released in it: such a fork is ended when it stands still.
    """
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s),) * 2)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            run()
            status = 0
        finally:
            os._exit(status)
    return ended(child, limit_s, STANDS_S)


def unchanged(path: Path) -> str:
    """The text of a file as the changed ones are written."""
    return ast.unparse(ast.parse((ROOT / path).read_text(encoding="utf-8")))


def change(path: Path, text: str) -> None:
    """Execute another text of a module in its namespace, and hand what it defines to our modules that hold it.

    The modules of a room whose parts are gathered are executed again where they import from the changed one, as what
    they declare is made of it, and last the one that gathers.
    """
    _execute(path, text)
    gathered_in = GATHERED.get(path.parent.as_posix())
    if gathered_in is None or path == gathered_in:
        return
    changed = {_name_of(path)}
    room = {file.relative_to(ROOT) for file in (ROOT / path.parent).glob("*.py")} - {path, gathered_in}
    while after := [it for it in room if {name.rpartition(".")[0] for name in _imported(ROOT / it)} & changed]:
        for other in sorted(after):
            _execute(other, unchanged(other))
        room.difference_update(after)
        changed = {_name_of(it) for it in after}
    _execute(gathered_in, unchanged(gathered_in))


def _execute(path: Path, text: str) -> None:
    """Execute a text in the namespace of a module, and of its copy that tests have of it uncompiled."""
    copies = list(sys.modules[UNCOMPILED]._all().values()) if UNCOMPILED in sys.modules else []
    for module in [importlib.import_module(_name_of(path)), *(one for one in copies if one.__name__ == _name_of(path))]:
        before = dict(vars(module))
        exec(compile(text, str(ROOT / path), "exec"), vars(module))  # noqa: S102  # our own code
        for name, new in vars(module).items():
            if inspect.isclass(new) and new.__module__ == module.__name__ and inspect.isclass(old := before.get(name)):
                for part in [part for part, value in vars(new).items() if _is_handed_over(part, value, path)]:
                    with suppress(AttributeError, TypeError):  # of an enumeration, or one with slots
                        setattr(old, part, vars(new)[part])  # so that what the old one made acts as the new one says
        for other in [*_ours(), *copies]:
            for name in _imported(Path(str(other.__file__))):
                owner, _, what = name.rpartition(".")
                ours = owner == module.__name__ or callable(before.get(what))  # it may come by way of another module
                if ours and what in before and vars(other).get(what) is before[what]:
                    setattr(other, what, vars(module)[what])


def _name_of(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def _is_handed_over(name: str, part: object, path: Path) -> bool:
    """Whether what an old class made acts by this part of the new one: not by what a decorator writes, as __init__."""
    special = name.startswith("__")
    written = isinstance(part, FunctionType) and part.__code__.co_filename == str(ROOT / path)
    return (written or not special) and not _calls_super(part)


def _calls_super(part: object) -> bool:
    """Whether a method or property knows its class, which for what the old class made is another one."""
    function = part.fget if isinstance(part, property) else part
    return isinstance(function, FunctionType) and "__class__" in function.__code__.co_freevars


def compiled_lines(file: Path) -> frozenset[int]:
    """Lines of compiled functions, unless the compiler is off: what was compiled before calls them unchanged."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        return frozenset()
    functions = [
        node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.FunctionDef)
    ]
    chosen = [node for node in functions if any("compiled" in ast.unparse(item) for item in node.decorator_list)]
    return frozenset(line for node in chosen for line in range(node.lineno, (node.end_lineno or 0) + 1))


def _ours() -> list[ModuleType]:
    """Our modules that are loaded."""
    return [module for module in sys.modules.values() if str(getattr(module, "__file__", "")).startswith(_OURS)]


# Rooms whose modules are found, not imported by name, and the module that gathers what they declare.
GATHERED = {"simulator/effects": Path("simulator/effects/catalogue.py")}
STANDS_S = 10.0  # for which a fork that has all imported does nothing only if it waits for ever
UNCOMPILED = "tests.simulator.plain"  # what it holds are modules of their own
_imported = cache(imported)
_OURS = tuple(f"{ROOT / name}{os.sep}" for name in OURS)  # an environment within the project's folder is not ours


def main() -> int:
    """Try a sample of mutants; exit status 1 where fewer are noticed than asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, help="files or folders to change, from the project's root")
    parser.add_argument("--tests", nargs="+", required=True, help="tests to run, from the project's root")
    parser.add_argument("--constants", action="store_true", help="only double the numbers that modules name, all")
    parser.add_argument("--sample", type=int, default=60, help="mutants to try (default 60)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument(
        "--longest-s", type=float, default=10, help="leave out tests of more processor time (default 10)"
    )
    parser.add_argument("--no-jit", action="store_true", help="without numba's compiler, whose code no change reaches")
    parser.add_argument("--wanted", type=float, default=0.9, help="share to be noticed (default 0.9)")
    said = parser.parse_args()
    if said.no_jit:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    files = [file for path in said.paths for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path])]
    everything = [mutant for file in files for mutant in mutants(file) if mutant.line not in compiled_lines(file)]
    chosen = [mutant for mutant in everything if mutant.is_constant_of_module]
    if not said.constants:
        chosen = random.Random(said.seed).sample(everything, min(said.sample, len(everything)))  # noqa: S311
    trial = Trial(chosen, reach := Reach(ROOT), said.longest_s)
    pytest.main(["-q", "-s", "-p", "no:cacheprovider", "--assert=plain", *said.tests], plugins=[reach, trial])
    if trial.failed or not trial.tried:
        print(f"none of {len(everything)} mutants could be tried")
        return 1
    share = 1 - trial.survived / trial.tried
    print(f"{trial.tried} of {len(everything)} mutants (seed {said.seed}): {100 * share:.0f} % noticed")
    return int(share < said.wanted)


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main())
