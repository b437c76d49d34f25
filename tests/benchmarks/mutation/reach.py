"""Which tests reach which functions, so that a change is tried on the tests that can notice it, the cheapest first."""

from __future__ import annotations

import ast
import sys
import threading
import time
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

Place = tuple[str, int]  # a file, from the project's root, and the first line of a function
OURS = ("calibration", "simulator", "evaluator", "tests")


@dataclass(eq=False)
class Reach:
    """A plugin of pytest that notes which of our functions each test calls, and the processor time that it takes, s.

    A test has what the fixtures call that it shares with others. Compiled functions and other processes are not seen.
    """

    root: Path
    called: dict[str, set[Place]] = field(default_factory=dict)
    time_s: dict[str, float] = field(default_factory=dict)
    _now: set[tuple[str, int]] = field(default_factory=set)
    _shared: dict[int, set[tuple[str, int]]] = field(default_factory=dict)

    def _call(self, frame: FrameType, *_: object) -> None:
        self._now.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """Note what a test calls."""
        self._now = set()
        began = time.process_time()
        threading.settrace(self._call)
        sys.settrace(self._call)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]
            self.time_s[item.nodeid] = time.process_time() - began
            for definitions in item._fixtureinfo.name2fixturedefs.values():  # type: ignore[attr-defined]
                self._now |= self._shared.get(id(definitions[-1]), set())
            self.called[item.nodeid] = set(self._ours(self._now.copy()))  # threads of a server may still add to it

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
        """Note what a fixture calls that several tests share."""
        if fixturedef.scope == "function":
            return (yield)
        outer, self._now = self._now, set()
        try:
            return (yield)
        finally:
            self._shared[id(fixturedef)] = self._now
            self._now = outer | self._now

    def _ours(self, places: Iterable[tuple[str, int]]) -> Iterator[Place]:
        for name, line in places:
            if Path(name).is_relative_to(self.root):
                yield str(Path(name).relative_to(self.root)), line


@dataclass(eq=False)
class Chosen:
    """A plugin of pytest that leaves only some tests, in the order of files and then of time."""

    tests: frozenset[str]
    time_s: dict[str, float]

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Leave only the chosen tests, the cheapest first; tests of a file stay together, for what they share."""
        items[:] = [item for item in items if item.nodeid in self.tests]
        whole: dict[str, float] = {}
        for item in items:
            file = item.nodeid.partition("::")[0]
            whole[file] = whole.get(file, 0.0) + self.time_s[item.nodeid]
        items.sort(
            key=lambda item: (
                whole[item.nodeid.partition("::")[0]],
                item.nodeid.partition("::")[0],
                self.time_s[item.nodeid],
            )
        )


@dataclass(frozen=True, eq=False)
class Unit:
    """A function, a method, or a statement outside of functions: first and last line, names it gives and mentions.

    plain: a function that nothing compiles or wraps, so that each of its calls is seen.
    """

    path: str
    first: int
    last: int
    gives: frozenset[str]
    mentions: frozenset[str]
    function: bool
    plain: bool


def units(root: Path) -> list[Unit]:
    """All units of our code and of our tests."""
    files = [file for name in OURS for file in sorted((root / name).rglob("*.py"))]
    return [unit for file in files for unit in _units_of(file, str(file.relative_to(root)))]


def _units_of(file: Path, path: str) -> Iterator[Unit]:
    def within(body: list[ast.stmt], owner: frozenset[str]) -> Iterator[Unit]:
        for node in body:
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                continue
            if isinstance(node, ast.ClassDef):
                yield from within(node.body, frozenset({node.name}))
                continue
            function = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
            named = (
                {node.name}
                if function
                else {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
            )
            read = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
            read |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
            first = min([node.lineno, *(item.lineno for item in getattr(node, "decorator_list", []))])
            yield Unit(
                path,
                first,
                node.end_lineno or first,
                frozenset(named) | (frozenset() if function else owner),
                frozenset(read),
                function,
                function and first == node.lineno,
            )

    yield from within(ast.parse(file.read_text(encoding="utf-8")).body, frozenset())


def tests_of(
    path: Path, line: int, everything: list[Unit], called: dict[str, set[Place]], *, in_process: bool
) -> frozenset[str]:
    """Tests that reach a line of a file: that call its function or, of what is no function, or is compiled or called by
    other processes, any function that mentions it, directly or by way of others.

    in_process: nothing is changed in other processes, so that a plain function without a call is reached by none.
    """
    callers: dict[Place, set[str]] = {}
    for test, places in called.items():
        for place in places:
            callers.setdefault(place, set()).add(test)
    users: dict[str, list[Unit]] = {}
    for unit in everything:
        for name in unit.mentions:
            users.setdefault(name, []).append(unit)
    wait = [unit for unit in everything if unit.path == str(path) and unit.first <= line <= unit.last]
    seen: set[Unit] = set(wait)
    found: set[str] = set()
    while wait:
        unit = wait.pop()
        tests = callers.get((unit.path, unit.first), set()) if unit.function else set()
        found |= tests
        if not tests and not (in_process and unit.plain):
            more = {user for name in unit.gives for user in users.get(name, ())} - seen
            seen |= more
            wait += more
    return frozenset(found)
