"""turnscope effects: the catalogue of effects."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.options import PATH, json_option

if TYPE_CHECKING:
    from simulator.effects.definition import Effect

WIDTH = 100  # of the lines of a list, in a terminal that is as wide


@click.command(
    epilog="\b\nExamples:\n  turnscope effects\n  turnscope effects plate-tilt\n  turnscope effects --html effects.html"
)
@click.argument("effect_id", required=False, metavar="[ID]")
@click.option("--html", type=PATH, metavar="FILE", help="Write the whole catalogue as a page with drawings.")
@json_option
def effects(effect_id: str | None, html: Path | None, as_json: bool) -> None:
    """List the effects that can be simulated and found, or describe one: its law, parameters, source and limits."""
    from evaluator.errors import InputError
    from simulator.effects.catalogue import EFFECTS, nearest_effect

    if html is not None:
        if effect_id is not None or as_json:
            raise InputError("--html FILE writes the page of all effects; it takes neither an ID nor --json")
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


def described(effect: Effect) -> dict[str, Any]:
    """An effect for programs; a bound that there is not is null."""
    return {
        "id": effect.id,
        "name": effect.name,
        "sentence": effect.sentence,
        "law": effect.law,
        "source": effect.source,
        "limits": effect.limits,
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
    lines.write_dl([("law", effect.law), ("source", effect.source), ("limits", effect.limits)])
    return f"{lines.getvalue()}\n{text_table(HEAD, parameter_rows(effect))}"


def _write_page(path: Path) -> None:
    from evaluator.files import write_text
    from evaluator.report.pages.effects import effects_page

    write_text(path, effects_page())
    click.echo(path)
