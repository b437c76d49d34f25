"""The image of the design, held: import contracts, and nothing unexpected at the top level."""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
ROOMS = ("calibration", "simulator", "evaluator")


def test_import_contracts_hold() -> None:
    run = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as lint; lint()", "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


MOST_FILES = 14  # of a folder, so that its listing reads as a table of contents
CATALOGUES = ("simulator/effects",)  # a file an effect


def test_no_modules_import_each_other_not_even_inside_functions() -> None:
    graph = grimp.build_graph("calibration", "simulator", "evaluator", cache_dir=None)
    imported = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    stubs = [path for room in ROOMS for path in (ROOT / room).rglob("__init__.pyi")]
    assert len(stubs) == 5
    for path in stubs:  # what a package imports when a name of it is first used
        package = ".".join(path.parent.relative_to(ROOT).parts)
        imported[package] = imported[package] | named_by_stub(package, path.read_text(encoding="utf-8"))
    assert cycles_of(imported) == []


def named_by_stub(package: str, stub: str) -> set[str]:
    """Modules from which a package takes its public names."""
    return {f"{package}.{node.module}" for node in ast.walk(ast.parse(stub)) if isinstance(node, ast.ImportFrom)}


def test_cycles_are_found() -> None:
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": set[str]()}
    assert cycles_of(imports) == [["a", "b", "c"]]


def test_a_folder_lists_few_files() -> None:
    folders = {path.parent for room in ROOMS for path in (ROOT / room).rglob("*.py")}
    crowded = {
        str(folder.relative_to(ROOT)): count
        for folder in folders
        if (count := len(list(folder.glob("*.py")))) > MOST_FILES
        and folder.relative_to(ROOT).as_posix() not in CATALOGUES
    }
    assert crowded == {}


def cycles_of(imported: Mapping[str, Collection[str]]) -> list[list[str]]:
    """Groups of modules each of which is reached from every other one by following imports."""
    reached = {module: reachable(module, imported) for module in imported}
    groups = {
        tuple(sorted(other for other in reached[module] if module in reached[other]))
        for module in imported
        if module in reached[module]
    }
    return [list(group) for group in sorted(groups)]


def reachable(module: str, imported: Mapping[str, Collection[str]]) -> set[str]:
    """Modules that are imported from a module on, at any distance."""
    found: set[str] = set()
    ahead = list(imported[module])
    while ahead:
        following = ahead.pop()
        if following not in found:
            found.add(following)
            ahead += imported.get(following, ())
    return found


def test_every_module_of_physics_but_rendering_is_kept_from_calibration() -> None:
    offenders = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "simulator").rglob("*.py")
        if "rendering" not in path.parts and "calibration" in _imported(path)
    ]
    # these hand on the compiler of all kernels, and how tables are written, which see no pixels
    assert sorted(offenders) == ["simulator/compilation.py", "simulator/units.py"]


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


def test_tests_import_nothing_from_benchmarks() -> None:
    folder = ROOT / "tests"
    files = [path for path in folder.rglob("*.py") if "benchmarks" not in path.relative_to(folder).parts]
    assert len(files) > 100
    named = [path for path in files if "benchmarks" in path.read_text(encoding="utf-8")]  # to parse takes longer
    assert [str(path.relative_to(ROOT)) for path in named if "tests.benchmarks" in _modules(path)] == []


def _modules(path: Path) -> str:
    """Names of all modules that a file imports, and of what it takes from them."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return " ".join(found)


# To parse whole files takes thirty times as long, and misses the scripts that tests hold as text.
FROM_OURS = re.compile(rf"^[ \t]*(from (?:tests|{'|'.join(ROOMS)})\b[\w.]* import (?:\([^)]*\)|[^\n]*))", re.MULTILINE)


def _imports_of_ours(text: str) -> Iterator[ast.ImportFrom]:
    """What a file takes from modules of this project."""
    for statement in FROM_OURS.findall(text):
        yield from (node for node in ast.parse(statement).body if isinstance(node, ast.ImportFrom))


def test_imports_are_read_from_blocks_over_several_lines_and_from_scripts_in_text() -> None:
    text = "from tests.a import b\nimport re\nif x:\n    from simulator import (\n        c as d,\n        e,\n    )\n"
    text += 'S = """\nfrom evaluator.f import g  # h\nfrom os import i\n"""\n'
    found = [(node.module, alias.name) for node in _imports_of_ours(text) for alias in node.names]
    assert found == [("tests.a", "b"), ("simulator", "c"), ("simulator", "e"), ("evaluator.f", "g")]


def test_what_benchmarks_and_tests_import_is_there() -> None:
    """No test runs the benchmarks: a name that moved would be noticed by whoever measures next."""
    missing = [
        f"{path.relative_to(ROOT)}: from {node.module} import {alias.name}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for node in _imports_of_ours(path.read_text(encoding="utf-8"))
        for alias in node.names
        if alias.name not in names_in(str(node.module))
    ]
    assert missing == []


@functools.cache
def names_in(module: str) -> set[str]:
    """What can be imported from a module of this project: what it and its stub define, and modules inside."""
    place = ROOT / module.replace(".", "/")
    files = [place.with_suffix(".py"), place / "__init__.py", place / "__init__.pyi"]
    found = {path.stem for path in place.glob("*") if path.suffix == ".py" or path.is_dir()}
    wait = [node for path in files if path.is_file() for node in ast.parse(path.read_text(encoding="utf-8")).body]
    while wait:
        node = wait.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
        elif isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.Assign):
            wait += node.targets
        else:  # what stands in a condition, or one of several targets
            wait += [inside for inside in ast.iter_child_nodes(node) if isinstance(inside, ast.stmt | ast.expr)]
    return found
