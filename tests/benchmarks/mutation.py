"""Mutation tests: one small change at a time is made to the code, and the tests are run; do they notice?

Changes: a comparison or an arithmetic operator exchanged, a number doubled, a sign flipped, a condition negated, a
statement left out. Every change is made in a copy of the project, so that the project itself is never touched; the
tests of the unchanged copy have to pass first.

    python -m tests.benchmarks.mutation evaluator/pose.py --tests tests/evaluator/test_pose.py --sample 30 --seed 1
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).parents[2]
OURS = ("calibration", "simulator", "evaluator", "tests")
LIBRARIES = (
    *("numpy", "scipy.optimize", "scipy.stats", "scipy.signal", "pandas", "numba", "cv2", "pydantic", "pytest"),
    "hypothesis",
)
PAIRS = (
    *((ast.Lt, ast.GtE), (ast.LtE, ast.Gt), (ast.Gt, ast.LtE), (ast.GtE, ast.Lt), (ast.Eq, ast.NotEq)),
    *((ast.NotEq, ast.Eq), (ast.Add, ast.Sub), (ast.Sub, ast.Add), (ast.Mult, ast.Div), (ast.Div, ast.Mult)),
    *((ast.Pow, ast.Mult), (ast.And, ast.Or), (ast.Or, ast.And), (ast.BitAnd, ast.BitOr), (ast.BitOr, ast.BitAnd)),
)
SWAPPED: dict[type[ast.AST], type[ast.AST]] = dict(PAIRS)
Change = tuple[str, Callable[[], None]]


@dataclass(frozen=True)
class Mutant:
    """One change: file, line, what it is; number of the node in the file, and of the change among the node's."""

    path: Path
    line: int
    change: str
    node: int
    number: int

    def text(self) -> str:
        """The text of the changed file."""
        tree = ast.parse((ROOT / self.path).read_text(encoding="utf-8"))
        target = next(node for index, node in enumerate(ast.walk(tree)) if index == self.node)
        _changes(target)[self.number][1]()
        return ast.unparse(ast.fix_missing_locations(tree))


def mutants(path: Path) -> Iterator[Mutant]:
    """All changes of a file; text, docstrings and type annotations are left alone."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    indices = {id(node): index for index, node in enumerate(ast.walk(tree))}
    for node in (node for top in tree.body for node in _code(top)):
        for number, (change, _) in enumerate(_changes(node)):
            yield Mutant(path, getattr(node, "lineno", 0), change, indices[id(node)], number)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that are run, in order."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params") or isinstance(node, ast.JoinedStr):
            continue
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, ast.AST):
                yield from _code(item)


def _changes(node: ast.AST) -> list[Change]:
    """Changes of one node: a name, and the function that makes it."""
    return [*_of_operators(node), *_of_values(node), *_of_statements(node)]


def _of_operators(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp)) and type(node.op) in SWAPPED:
        new = SWAPPED[type(node.op)]
        yield f"{type(node.op).__name__} -> {new.__name__}", lambda: setattr(node, "op", new())
    if isinstance(node, ast.Compare):
        for index, operator in enumerate(node.ops):
            if type(operator) in SWAPPED:
                new = SWAPPED[type(operator)]
                change = partial(node.ops.__setitem__, index, new())
                yield f"{type(operator).__name__} -> {new.__name__}", change


def _of_values(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = 2 * node.value or 1
        yield f"{node.value} -> {value}", lambda: setattr(node, "value", value)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "- -> +", lambda: setattr(node, "op", ast.UAdd())
    if isinstance(node, (ast.If, ast.IfExp, ast.While)):
        yield "condition negated", lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))


def _of_statements(node: ast.AST) -> Iterator[Change]:
    if not isinstance(node, (ast.FunctionDef, ast.If, ast.For, ast.While, ast.With)):
        return
    for index, item in enumerate(node.body):
        said = isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant)  # a docstring
        effect = isinstance(item, (ast.AugAssign, ast.Expr)) and not said
        if effect or (isinstance(item, ast.Assign) and _assigned_before(node, item)):
            yield f"left out: {ast.unparse(item)[:60]}", partial(node.body.__setitem__, index, ast.Pass())


def _assigned_before(owner: ast.AST, item: ast.Assign) -> bool:
    """Whether what a statement assigns has a value before: only then can the statement be left out."""
    names = {name.id for target in item.targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    read = {name.id for name in ast.walk(item.value) if isinstance(name, ast.Name)}
    return isinstance(owner, (ast.FunctionDef, ast.If)) and bool(names & read)


def prepare(*, jit: bool) -> None:
    """Import what is not ours, once: every run of the tests is a fork of this process, and starts at once."""
    os.environ |= {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    if not jit:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    for name in LIBRARIES:
        importlib.import_module(name)


def preload(folder: Path, tests: list[str]) -> None:
    """Import what the tests import of a copy, once: a run of the tests imports anew what depends on a change."""
    os.chdir(folder)
    os.environ["PYTHONPATH"] = str(folder)
    sys.path.insert(0, str(folder))
    for name in [name for name in sys.modules if name.partition(".")[0] in OURS]:
        del sys.modules[name]
    files = [file for test in tests for file in ([Path(test)] if test.endswith(".py") else Path(test).rglob("*.py"))]
    for name in sorted({name for file in files for name in _imported(file)}):
        if name.partition(".")[0] in OURS and importlib.util.find_spec(name.partition(".")[0]):
            with suppress(ImportError):  # what a module holds, not a module
                importlib.import_module(name)


def _imported(file: Path) -> set[str]:
    """Names of modules that a file imports anywhere, and of what it imports of them."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def dependents(path: Path) -> frozenset[str]:
    """Loaded modules of ours that import a file, directly or not, and the file itself; all that is of the tests."""
    ours = {name: module for name, module in sys.modules.items() if name.partition(".")[0] in OURS}
    uses = {name: _imported(Path(module.__file__)) for name, module in ours.items() if module.__file__}
    found = {".".join(path.with_suffix("").parts).removesuffix(".__init__")}
    found |= {name for name in ours if name.startswith("tests")}
    while more := {name for name, used in uses.items() if name not in found and used & found}:
        found |= more
    return frozenset(found)


def suite_passes(
    tests: list[str], limit_s: float, changed: frozenset[str] = frozenset(), *, quiet: bool = True
) -> bool | None:
    """Run tests in a process of its own, changed modules imported anew; None where it took longer than the limit."""
    child = os.fork()
    if child == 0:
        _run_and_leave(tests, changed, quiet=quiet)
    ends = time.monotonic() + limit_s
    while time.monotonic() < ends:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _run_and_leave(tests: list[str], changed: frozenset[str], *, quiet: bool) -> NoReturn:
    """In a process of its own: run the tests and exit with their status."""
    status = 1
    try:
        os.setsid()
        if quiet:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
        for name in changed & set(sys.modules):
            package, _, last = name.rpartition(".")
            if package in sys.modules:  # `from package import module` takes what the package holds
                vars(sys.modules[package]).pop(last, None)
            del sys.modules[name]
        import pytest

        status = int(pytest.main(["-q", "-x", "--assert=plain", "-p", "no:cacheprovider", *tests]))
    finally:
        sys.stdout.flush()
        os._exit(status)


def main() -> int:
    """Run a sample of mutants; exit status 1 where fewer are noticed than asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, help="files or folders to change, from the project's root")
    parser.add_argument("--tests", nargs="+", required=True, help="tests to run, from the project's root")
    parser.add_argument("--sample", type=int, default=60, help="mutants to try (default 60)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument("--limit-s", type=float, help="time for one run (default: three times the unchanged tests')")
    parser.add_argument("--no-jit", action="store_true", help="without numba's compiler: faster where loops are short")
    parser.add_argument("--wanted", type=float, default=0.9, help="share to be noticed (default 0.9)")
    said = parser.parse_args()
    prepare(jit=not said.no_jit)
    paths = [
        file.relative_to(ROOT)
        for path in said.paths
        for file in (sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path])
    ]
    everything = [mutant for path in paths for mutant in mutants(path)]
    chosen = random.Random(said.seed).sample(everything, min(said.sample, len(everything)))  # noqa: S311
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "project"
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "out"))  # compiled kernels come along
        preload(folder, said.tests)
        began = time.monotonic()
        if not suite_passes(said.tests, 3600, frozenset().union(*map(dependents, paths)), quiet=False):
            print("the tests do not pass on the unchanged code")
            return 2
        limit_s = said.limit_s or 3 * (time.monotonic() - began) + 10
        survived = []
        for number, mutant in enumerate(chosen, 1):
            file = folder / mutant.path
            shutil.copy2(file, original := Path(name) / "original.py")
            file.write_text(mutant.text(), encoding="utf-8")
            passed = suite_passes(said.tests, limit_s, dependents(mutant.path))
            shutil.copy2(original, file)  # with its time: a kernel is compiled anew where a source is younger
            if passed:
                survived.append(mutant)
                print(f"survived  {number}/{len(chosen)}  {mutant.path}:{mutant.line}  {mutant.change}", flush=True)
    share = 1 - len(survived) / len(chosen)
    print(f"{len(chosen)} of {len(everything)} mutants (seed {said.seed}): {100 * share:.0f} % noticed")
    return 0 if share >= said.wanted else 1


if __name__ == "__main__":
    sys.exit(main())
