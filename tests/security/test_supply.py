"""What is installed is what was locked, byte for byte, and the code never runs what a file says."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", re.MULTILINE)
HASHED = (".ci/hashes.txt", ".ci/hashes-test.txt")
# Builds the distribution; pip takes it from outside the constraints of an installation.
OF_THE_BUILD = {"hatchling", "editables", "trove-classifiers", "pathspec", "tomlkit"}
UNSAFE_MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}
# A reader of lists, texts and numbers that refuses whatever would be imported.
PLAIN_PICKLE = "evaluator/interchange/pose_estimators.py"
UNSAFE_CALLS = {"eval", "exec", "compile", "__import__"}


def pins(path: str) -> set[tuple[str, str]]:
    return set(PIN.findall((ROOT / path).read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", HASHED)
def test_every_hashed_pin_has_hashes_and_is_that_of_the_lock(path: str) -> None:
    text = (ROOT / path).read_text(encoding="utf-8")
    entries = [entry for entry in re.split(r"\n(?=[^\s#])", text) if PIN.match(entry)]
    assert len(entries) > 25
    assert [entry.split()[0] for entry in entries if "--hash=sha256:" not in entry] == []
    assert {pin for pin in pins(path) if pin[0] not in OF_THE_BUILD} <= pins(".ci/lock.txt")


@pytest.mark.parametrize("path", HASHED)
def test_every_dependency_is_among_the_hashed_pins(path: str) -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.split(r"[<>=\[ ]", line)[0].lower() for line in project["dependencies"]}
    assert needed <= {name.lower() for name, _ in pins(path)}


def test_nothing_in_the_code_runs_what_a_file_says() -> None:
    offenders = []
    for room in ("calibration", "simulator", "evaluator"):
        for path in (ROOT / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = set()
                if isinstance(node, ast.Import):
                    names = {alias.name.split(".")[0] for alias in node.names} & UNSAFE_MODULES
                elif isinstance(node, ast.ImportFrom):
                    names = {(node.module or "").split(".")[0]} & UNSAFE_MODULES
                elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                    names = {node.func.id} & UNSAFE_CALLS
                elif isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
                    names = {node.arg}
                offenders += [f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}: {name}" for name in names]
    assert [offender for offender in offenders if not offender.startswith(PLAIN_PICKLE)] == []


def test_a_pickle_that_would_run_something_is_refused(tmp_path: Path) -> None:
    import pickle

    from evaluator.interchange.pose_estimators import _plain_pickle

    class Runs:
        def __reduce__(self) -> tuple[object, tuple[object, ...]]:
            return (Path.touch, (tmp_path / "ran",))

    with pytest.raises(ValueError, match="no list of names"):
        _plain_pickle(pickle.dumps([Runs()]))
    assert not (tmp_path / "ran").exists()
    assert _plain_pickle(pickle.dumps([(1, ["net", "green", "x"])])) == [(1, ["net", "green", "x"])]
