"""Logs of wheeled robots of another simulator: `python -m tests.benchmarks.driven_laboratory --sessions 28 --seed 7`.

Sessions of tests/driven_laboratory are written as files, diagnosed by the command line in a process of its own, and
scored against truths that lie in another folder. With --keep an interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.laboratory import diagnosis_of
from tests.benchmarks.laboratory_table import share
from tests.driven_laboratory.session import KINDS, draw, write

RELEVANT_SHARE = 0.5  # of the noise: what moves less is not part of a verdict ([relevant] of experiment.toml)


def main() -> None:
    """Draw, diagnose, score, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.driven_laboratory", description=__doc__)
    parser.add_argument("--sessions", type=int, default=len(KINDS), help="in turn of each kind (default: one of each)")
    parser.add_argument("--only", nargs="*", choices=KINDS, default=list(KINDS), help="kinds (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--keep", type=Path, help="folder for sessions, truths and rows; continues there")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        rows = []
        for number in range(chosen.sessions):
            kind = chosen.only[number % len(chosen.only)]
            rows.append(_row(folder, kind, chosen.seed + number // len(chosen.only)))
            print(_line(rows[-1]), flush=True)
        print(_table(rows))


def _row(folder: Path, kind: str, seed: int) -> dict[str, Any]:
    """Draw a session, diagnose it and score the answer; or what an earlier run of this benchmark found."""
    file = folder / "rows" / f"{kind}-{seed}.json"
    if not file.exists():
        where, truth = folder / f"{seed}-{list(KINDS).index(kind):02d}", folder / "truths" / f"{kind}-{seed}"
        write(draw(kind, seed), where, truth)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        answer, message = diagnosis_of(where)
        seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        hidden = json.loads((truth / "truth.json").read_text(encoding="utf-8"))
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(scored(hidden, answer) | {"seconds": seconds, "message": message}), encoding="utf-8")
    return {"key": f"{kind}-{seed}", "kind": kind, **json.loads(file.read_text(encoding="utf-8"))}


def scored(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    """What an answer says, and how it compares with the truth."""
    verdict = answer.get("verdict", "no answer")
    effects = {item["id"]: item for item in answer.get("effects", []) if "id" in item} if verdict == "effect" else {}
    effect = truth["effect"]  # None: outside the catalogue; "": nothing is missing
    if not effect:
        right = verdict == ("unknown" if effect is None else "none")
    else:
        right = len(effects) == 1 and any(
            effect in {name, *item.get("equivalent", [])} for name, item in effects.items()
        )
        right |= verdict == "none" and effect in _told_as_values(answer)
    right |= verdict == "none" and truth["moves"] < RELEVANT_SHARE
    found = effects.get(effect, {}).get("parameters", {}) if effect else {}
    held = [_holds(name, found[name], value) for name, value in truth["parameters"].items() if name in found]
    return {
        "verdict": verdict,
        "moves": truth["moves"],
        "named": {
            name: {key: spread["value"] for key, spread in item["parameters"].items()} for name, item in effects.items()
        },
        "right": right,
        "held": held,
        "mistakes": [f"{', '.join(item['runs'])}: {item['kind']}" for item in answer.get("mistakes", [])],
        "reason": answer.get("reason", ""),
    }


def _told_as_values(answer: dict[str, Any]) -> set[str]:
    """Effects equivalent to a known value that is told to be off its tolerance, such as a centre of gravity."""
    told = [str(sentence) for sentence in answer.get("findings") or []]
    values = [known for known in answer.get("known_to") or [] if any(s.startswith(f"{known['name']}:") for s in told)]
    return {effect for known in values for effect in known.get("equivalent") or []}


def _holds(name: str, spread: dict[str, Any], true: float) -> bool:
    """Whether the 95 % interval of a parameter holds its true value; an angle in any turn."""
    turns = 360.0 * np.arange(-1, 2) if name == "azimuth_deg" else np.zeros(1)
    low, high = (end if end is not None else way * np.inf for end, way in ((spread["low"], -1), (spread["high"], 1)))
    return bool(np.any((low <= true + turns) & (true + turns <= high)))


def _line(row: dict[str, Any]) -> str:
    said = " ".join(f"{name} {json.dumps(values)}" for name, values in row["named"].items())
    mark, mistakes = "right" if row["right"] else "WRONG", "; ".join(row["mistakes"])
    said += f" (moves {row['moves']:.2g} noise)" if row["moves"] < RELEVANT_SHARE else ""
    return f"{row['key']:22} {mark} {row['verdict']} {said} {row['seconds']:.0f} s {mistakes} {row['message']}".rstrip()


def _table(rows: Sequence[dict[str, Any]]) -> str:
    """Shares of right answers, of values within their intervals, and processor times."""
    lines = ["", f"{'kind':20} right"]
    parts = {kind: [row["right"] for row in rows if row["kind"] == kind] for kind in KINDS}
    lines += [f"{kind:20} {sum(part)} of {len(part)}" for kind, part in parts.items() if part]
    misnamed = [row for row in rows if row["verdict"] == "effect" and not row["right"]]
    held, seconds = [hold for row in rows for hold in row["held"]], [row["seconds"] for row in rows]
    lines += [
        f"right                {share(sum(row['right'] for row in rows), len(rows))}",
        f"misnamed             {share(len(misnamed), len(rows))}",
        f"true values held     {share(sum(held), len(held))}",
        f"sessions with runs called mistaken: {sum(bool(row['mistakes']) for row in rows)}",
        f"CPU                  {np.median(seconds):.0f} s median, {max(seconds):.0f} s most",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
