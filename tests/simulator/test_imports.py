"""No module of the simulator needs, by way of others, itself: imports in functions and for type checks included."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]


def _modules() -> dict[str, Path]:
    found = {}
    for path in (ROOT / "simulator").rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def _imports(path: Path, modules: dict[str, Path]) -> set[str]:
    named: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            below = {f"{node.module}.{alias.name}" for alias in node.names} & modules.keys()
            named |= below or {node.module}
    return named & modules.keys()


def test_no_import_of_the_simulator_leads_back_to_where_it_began() -> None:
    modules = _modules()
    # The package itself offers public names of its modules, which never import it back.
    needs = {name: _imports(path, modules) for name, path in modules.items() if name != "simulator"}
    # The catalogue finds every module that declares an effect.
    needs["simulator.effects.catalogue"] |= {
        name for name, path in modules.items() if "\nEFFECT = " in path.read_text(encoding="utf-8")
    }
    settled: set[str] = set()
    while ready := {name for name, needed in needs.items() if needed <= settled | {name, "simulator"}} - settled:
        settled |= ready
    assert sorted(needs.keys() - settled) == []
