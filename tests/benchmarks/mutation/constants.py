"""Numbers that modules name, each doubled in turn where it is used: do the tests notice?

Nothing is imported anew: in a fork of a process that has everything imported, the name gets its new value in every
module that imports it. So a number costs a second where a mutant costs several. Numbers inside compiled kernels, and
default values of arguments, stay as they were: for these there is `--constants` of the mutants.

    python -m tests.benchmarks.mutation.constants evaluator/comparison.py --tests tests/evaluator/test_comparison.py
"""

from __future__ import annotations

import argparse
import ast
import importlib
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from tests.benchmarks.mutation.mutants import ROOT
from tests.benchmarks.mutation.reach import OURS
from tests.benchmarks.mutation.runs import imported


def main() -> int:
    """Double every number; exit status 1 where no test notices one of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, help="files or folders with numbers, from the project's root")
    parser.add_argument("--tests", nargs="+", required=True, help="tests to run, the cheapest first")
    said = parser.parse_args()
    os.chdir(ROOT)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    files = [file for path in said.paths for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path])]
    for test in said.tests:  # what they import is imported once
        importlib.import_module(".".join(Path(test).with_suffix("").parts))
    if not _pass({}, ModuleType("none"), said.tests):
        print("the tests do not pass on the unchanged numbers")
        return 2
    count = survived = 0
    for file in files:
        module = importlib.import_module(".".join(file.with_suffix("").parts).removesuffix(".__init__"))
        for name in _names(file):
            for place, value in _doubled(getattr(module, name, None)):
                passed = _pass({name: value}, module, said.tests)
                count, survived = count + 1, survived + passed
                print(f"{file}  {name}{place}  {'survived' if passed else 'noticed'}", flush=True)
    print(f"{count - survived} of {count} numbers noticed")
    return 1 if survived else 0


def _names(file: Path) -> Iterator[str]:
    """Names that a module gives to values."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _doubled(value: Any) -> Iterator[tuple[str, Any]]:
    """A number doubled (0 becomes 1), or a tuple or mapping of numbers with one of them doubled, and its place."""
    if _is_number(value):
        yield "", 2 * value or 1
    elif isinstance(value, tuple) and value and all(map(_is_number, value)):
        yield from ((f"[{k}]", (*value[:k], 2 * value[k] or 1, *value[k + 1 :])) for k in range(len(value)))
    elif isinstance(value, dict) and value and all(map(_is_number, value.values())):
        yield from ((f"[{key!r}]", {**value, key: 2 * number or 1}) for key, number in value.items())


def _holders(owner: ModuleType, name: str) -> list[ModuleType]:
    """The module that names a value, and those that import it from there."""
    ours = [module for key, module in sys.modules.items() if key.partition(".")[0] in OURS and module.__file__]
    full = f"{owner.__name__}.{name}"
    return [owner, *(module for module in ours if full in _imported(Path(str(module.__file__))))]


_imported = cache(imported)


def _pass(changed: dict[str, Any], owner: ModuleType, tests: list[str]) -> bool:
    """Whether the tests pass in a fork in which names of a module have other values, wherever they were taken over."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            for name, value in changed.items():
                for module in _holders(owner, name):
                    setattr(module, name, value)
            import pytest

            status = int(pytest.main(["-q", "-x", "--assert=plain", "-p", "no:cacheprovider", *tests]))
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


if __name__ == "__main__":
    sys.exit(main())
