"""Run the code cells of a notebook, without Jupyter; `python -m tests.end_to_end.notebook` writes its outputs anew."""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from evaluator.workflow.samples import copy_samples, sample_folder

NOTEBOOK = "measure_a_turn.ipynb"
DPI = 60  # of the figures that are kept: the notebook stays below 150 kB


def run_cells(notebook: dict[str, Any]) -> list[list[dict[str, Any]]]:
    """Outputs of every code cell, run in order in the current folder."""
    names: dict[str, Any] = {}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return [outputs("".join(cell["source"]), names) for cell in cells]


def outputs(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """What a notebook shows of a cell: what it prints, and the value of a last expression."""
    tree, value, printed = ast.parse(source), None, io.StringIO()
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)  # noqa: S102 - our own notebook
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307
    found: list[dict[str, Any]] = []
    if text := printed.getvalue():
        found.append({"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)})
    if value is not None:
        found.append({"output_type": "display_data", "metadata": {}, "data": shown(value)})
    return found


def shown(value: Any) -> dict[str, Any]:
    """A value as notebooks show it: axes as their figure, what has HTML as that, and text."""
    from matplotlib.axes import Axes

    if isinstance(value, Axes):
        import matplotlib.pyplot as plt

        image = io.BytesIO()
        value.figure.savefig(image, format="png", dpi=DPI)
        plt.close("all")
        return {"image/png": base64.b64encode(image.getvalue()).decode(), "text/plain": ["<Axes>"]}
    data = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_html_"):
        data["text/html"] = value._repr_html_().splitlines(keepends=True)
    return data


def main() -> None:
    """Run the notebook on a copy of the samples and write its outputs into it."""
    path = sample_folder() / NOTEBOOK
    notebook = json.loads(path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        copy_samples(Path(folder))
        os.chdir(folder)
        found = run_cells(notebook)
        os.chdir("/")
    number = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            cell["outputs"], cell["execution_count"] = found[number], number + 1
            number += 1
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    sys.stdout.write(f"{path}: {path.stat().st_size / 1000:.0f} kB\n")


if __name__ == "__main__":
    main()
