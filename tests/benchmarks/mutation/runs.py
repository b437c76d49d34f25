"""Tests run in forks of one process that has everything imported, so that a run begins at once."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import math
import os
import pickle
import resource
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from tests.benchmarks.mutation.reach import OURS, Chosen, Reach

LIBRARIES = (
    *("numpy", "scipy.optimize", "scipy.stats", "scipy.signal", "pandas", "numba", "cv2", "pydantic", "pytest"),
    "hypothesis",
)
WAITS = 3  # times its processor time that a run may take beside what it waits for a core, before it waits for ever
BUSY = 10  # times as long, where the system does not tell how long it waits for a core
IDLE_S = 60.0  # and so is one that has done nothing at all for so long


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
    for name in sorted({name for file in files for name in imported(file)}):
        if name.partition(".")[0] in OURS and importlib.util.find_spec(name.partition(".")[0]):
            with suppress(ImportError):  # what a module holds, not a module
                importlib.import_module(name)


def imported(file: Path) -> set[str]:
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
    uses = {name: imported(Path(module.__file__)) for name, module in ours.items() if module.__file__}
    for name in [name for name, used in uses.items() if "pkgutil" in used]:  # it finds the modules beside it
        uses[name] |= {other for other in ours if other.rpartition(".")[0] == name.rpartition(".")[0]} - {name}
    found = {".".join(path.with_suffix("").parts).removesuffix(".__init__")}
    found |= {name for name in ours if name.startswith("tests")}
    while more := {name for name, used in uses.items() if name not in found and used & found}:
        found |= more
    return frozenset(found)


def observed(tests: list[str], changed: frozenset[str], folder: Path) -> Reach | None:
    """What each test calls and how long it takes, of the unchanged code; None where a test fails."""
    reach, file = Reach(folder), folder.parent / "reach.pickle"
    if not _passes(tests, 3600, changed, reach, file):
        return None
    reach.called, reach.time_s = pickle.loads(file.read_bytes())  # noqa: S301 (written by the fork)
    return reach


def pass_of(chosen: frozenset[str], reach: Reach, changed: frozenset[str], limit_s: float) -> bool | None:
    """Whether the chosen tests pass, changed modules imported anew; None where they took longer than the limit."""
    files = sorted({test.partition("::")[0] for test in chosen})
    return _passes(files, limit_s, changed, Chosen(chosen, reach.time_s), None)


def _passes(
    tests: list[str], limit_s: float, changed: frozenset[str], plugin: Reach | Chosen, file: Path | None
) -> bool | None:
    """Whether tests pass in a fork; None where they took longer than a limit of processor time, or wait for ever."""
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), math.ceil(limit_s) + 5))
        _run_and_leave(tests, changed, plugin, file)
    code = ended(child, limit_s)
    return None if code in (-signal.SIGXCPU, -signal.SIGKILL) else code == 0


def ended(child: int, limit_s: float, idle_s: float = IDLE_S) -> int:
    """Exit status of a child that leads its process group; it is killed where it seems to wait for ever.

    What it has started ends with it: workers of a pool would wait for a parent that is gone.
    """
    begun = idle_since = time.monotonic()
    worked, longest_s = "", WAITS * limit_s
    done, status = os.waitpid(child, os.WNOHANG)
    while not done and time.monotonic() < min(begun + longest_s, idle_since + idle_s):
        if (now := _worked(child)) != worked or not now:
            worked, idle_since = now, time.monotonic()
        delayed_s = _delayed_s(child)
        longest_s = WAITS * limit_s * BUSY if delayed_s is None else WAITS * limit_s + delayed_s
        time.sleep(0.02)
        done, status = os.waitpid(child, os.WNOHANG)
    with suppress(ProcessLookupError):  # nothing of the group is left
        os.killpg(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(status if done else os.waitpid(child, 0)[1])


def _worked(process: int) -> str:
    """What a process and those that it waited for have worked so far, in ticks; nothing where the system tells none."""
    try:
        return " ".join(Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[11:15])
    except OSError:
        return ""


def _delayed_s(process: int) -> float | None:
    """How long a process has waited for a core, as others had them, s; None where the system does not tell."""
    try:
        return int(Path(f"/proc/{process}/schedstat").read_text(encoding="ascii").split()[1]) / 1e9
    except (OSError, IndexError):
        return None


def _run_and_leave(tests: list[str], changed: frozenset[str], plugin: Reach | Chosen, file: Path | None) -> NoReturn:
    """In a process of its own: run the tests, write what they called to a file, and exit with their status."""
    status = 1
    try:
        os.setsid()
        if file is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
        for name in changed & set(sys.modules):
            package, _, last = name.rpartition(".")
            if package in sys.modules:  # `from package import module` takes what the package holds
                vars(sys.modules[package]).pop(last, None)
            del sys.modules[name]
        import pytest

        status = int(pytest.main(["-q", "-x", "--assert=plain", "-p", "no:cacheprovider", *tests], plugins=[plugin]))
        if file is not None and isinstance(plugin, Reach):
            file.write_bytes(pickle.dumps((plugin.called, plugin.time_s)))
    finally:
        sys.stdout.flush()
        os._exit(status)
