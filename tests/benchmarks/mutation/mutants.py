"""Small changes of the code: an operator exchanged, a number doubled, a sign flipped, a condition negated, a statement
left out. Text, docstrings and type annotations are left alone.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[3]
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
    is_constant_of_module: bool

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
    for top in tree.body:
        for node in _code(top):
            constant = isinstance(top, (ast.Assign, ast.AnnAssign)) and isinstance(node, ast.Constant)
            for number, (change, _) in enumerate(_changes(node)):
                yield Mutant(path, getattr(node, "lineno", 0), change, indices[id(node)], number, constant)


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
