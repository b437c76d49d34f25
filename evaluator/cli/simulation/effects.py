"""turnscope effects: the catalogue of physical effects."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.options import PATH, json_option

if TYPE_CHECKING:
    from simulator.effects.definition import Effect

WIDTH = 100  # largest width of the lines of a list, characters


@click.command(
    epilog="\b\nExamples:\n  turnscope effects\n  turnscope effects plate-tilt"
    "\n  turnscope effects --html effects.html\n  turnscope effects new mixed-drive"
)
@click.argument("effect_id", required=False, metavar="[ID | new ID]")
@click.argument("new_id", required=False, metavar="")
@click.option(
    "--effect", "files", type=PATH, multiple=True, metavar="FILE", help="Also load this effect (.toml or .py)."
)
@click.option("-o", "--out", type=PATH, metavar="FILE", help="With new: file to write. [default: effects/ID.toml]")
@click.option("--python", is_flag=True, help="With new: write a Python file, ID.py.")
@click.option("--html", type=PATH, metavar="FILE", help="Write the catalogue as a page with drawings.")
@json_option
def effects(
    effect_id: str | None,
    new_id: str | None,
    files: tuple[Path, ...],
    out: Path | None,
    python: bool,
    html: Path | None,
    as_json: bool,
) -> None:
    """List the physical effects, or describe one: its law, parameters, source and limits.

    The list includes effects of your own: files in the folder effects/, entry points turnscope.effects of installed
    packages, TURNSCOPE_EFFECTS, and --effect. turnscope effects new ID writes a commented template for a new one.
    """
    from evaluator.errors import InputError
    from evaluator.files import read_with
    from simulator.effects.catalogue import EFFECTS, nearest_effect
    from simulator.own_effects.files import load_beside, load_installed, load_named, load_own

    if effect_id == "new":
        _write_new(new_id, out, python=python)
        return
    if new_id is not None or out is not None or python:
        raise InputError("a second ID, -o FILE and --python belong to turnscope effects new ID")
    load_installed()
    load_named()
    load_beside(Path())
    for file in files:
        read_with(load_own, file)

    if html is not None:
        if effect_id is not None or as_json:
            raise InputError("--html FILE writes the page of all effects and takes neither an ID nor --json")
        _write_page(html)
        return
    if effect_id is not None and effect_id not in EFFECTS:
        near = nearest_effect(effect_id)
        hint = f"did you mean {near}?" if near in EFFECTS else "turnscope effects lists all"
        raise InputError(f"{effect_id}: no such effect; {hint}")
    if as_json:
        content = described(EFFECTS[effect_id]) if effect_id else [described(effect) for effect in EFFECTS.values()]
        click.echo(json.dumps(content, indent=2, ensure_ascii=False))
    elif effect_id:
        click.echo(_text(EFFECTS[effect_id]))
    else:
        lines = click.HelpFormatter(width=WIDTH)
        lines.write_dl([(effect.id, effect.sentence) for effect in EFFECTS.values()])
        click.echo(lines.getvalue().rstrip())


def _write_new(effect_id: str | None, out: Path | None, *, python: bool) -> None:
    """Write the template of a user's effect; an existing file is an error."""
    from evaluator.errors import InputError
    from evaluator.files import write_text
    from simulator.own_effects.files import ID_FORM, is_built_in
    from simulator.own_effects.template import python_template, template

    if effect_id is None or not ID_FORM.fullmatch(effect_id):
        raise InputError(
            f"turnscope effects new {effect_id or ''}: expected an id of lower-case letters, digits and hyphens, "
            "such as mixed-drive"
        )
    if is_built_in(effect_id):
        raise InputError(f"{effect_id} is an effect of the catalogue; choose another id")
    path = out or (Path(f"{effect_id}.py") if python else Path("effects") / f"{effect_id}.toml")
    if path.exists():
        raise InputError(f"{path} exists already; choose another id or -o FILE")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, python_template(effect_id, str(path)) if python else template(effect_id))
    click.echo(path)


def described(effect: Effect) -> dict[str, Any]:
    """An effect as JSON content; infinite bounds are null."""
    return {
        "id": effect.id,
        "name": effect.name,
        "sentence": effect.sentence,
        "law": effect.law,
        "source": effect.source,
        "limits": effect.where_valid,
        "kind": effect.kind,
        "varies_by_run": effect.varies_by_run,
        "parameters": [
            {
                "name": item.name,
                "unit": item.unit,
                "absent": item.absent,
                "step": item.step,
                "low": _finite(item.low),
                "high": _finite(item.high),
                "at_least": _finite(item.at_least),
                "period": item.period,
            }
            for item in effect.parameters
        ],
    }


def _finite(bound: float) -> float | None:
    return bound if math.isfinite(bound) else None


def _text(effect: Effect) -> str:
    from evaluator.cli.tables import text_table
    from evaluator.report.pages.effects import HEAD, parameter_rows

    lines = click.HelpFormatter(width=WIDTH)
    lines.write_text(f"{effect.id}: {effect.name}")
    lines.write_paragraph()
    lines.write_text(effect.sentence)
    lines.write_paragraph()
    lines.write_dl([("law", effect.law), ("source", effect.source), ("limits", effect.where_valid)])
    return f"{lines.getvalue()}\n{text_table(HEAD, parameter_rows(effect))}"


def _write_page(path: Path) -> None:
    from evaluator.files import write_text
    from evaluator.report.pages.effects import effects_page

    write_text(path, effects_page())
    click.echo(path)
