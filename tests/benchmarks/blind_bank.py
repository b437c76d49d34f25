"""Blind bank: `python -m tests.benchmarks.blind_bank --clean 200 --singles 100 --pairs 40 --outside 44 --seed 1`.

Draws experiments with hidden effects, diagnoses each through the files that a lab would have, and scores the answers
against labels that the diagnosis never sees (they are written only after it, outside its folder). Counts come with
their 95 % limits. With --next the run that a diagnosis proposes is made twice by the same hidden robot, and diagnosed
with the others.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from evaluator.workflow.diagnosis.experiment import diagnose_experiment
from tests.bank.draw import SIZES, Drawn, draw, repeated
from tests.bank.outside import KINDS
from tests.bank.visible import sigmas_beyond_named, visible_sigmas

DETECTABLE_SIGMAS = 5.0


def main() -> None:
    """Draw, diagnose, score, print."""
    arguments = argparse.ArgumentParser(description=__doc__)
    for name in ("clean", "singles", "pairs", "outside"):
        arguments.add_argument(f"--{name}", type=int, default=0)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--minutes", type=float, default=1e6, help="stop drawing after so many minutes")
    arguments.add_argument("--next", action="store_true", help="make the runs that a diagnosis proposes, and see")
    arguments.add_argument("--rows", type=Path, help="append every scored answer to this file, as JSON")
    arguments.add_argument("--table", type=Path, nargs="*", help="only print the table of these files")
    chosen = arguments.parse_args()
    if chosen.table:
        print(table([json.loads(line) for path in chosen.table for line in path.read_text().splitlines()]))
        return
    ends = time.monotonic() + 60 * chosen.minutes
    kinds = (
        [("clean", "")] * chosen.clean
        + [("single", sorted(SIZES)[i % len(SIZES)]) for i in range(chosen.singles)]
        + [("pair", "")] * chosen.pairs
        + [("outside", sorted(KINDS)[i % len(KINDS)]) for i in range(chosen.outside)]
    )
    order = np.random.default_rng(chosen.seed).permutation(len(kinds))
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in order:
            if time.monotonic() > ends:
                break
            kind, name = kinds[number]
            drawn = draw(np.random.default_rng([chosen.seed, int(number)]), kind, Path(folder) / f"e{number}", name)
            rows.append(_answer(drawn))
            if chosen.next and kind != "outside" and (rows[-1]["proposed"] or {}).get("runs"):
                rng = np.random.default_rng([chosen.seed, int(number), 1])
                rows[-1]["next"] = _answer(repeated(rng, drawn, rows[-1]["proposed"]["runs"]))
            print(_line(rows[-1]), flush=True)
            if chosen.rows:
                with chosen.rows.open("a", encoding="utf-8") as file:
                    print(json.dumps(rows[-1], default=list), file=file)
    print(table(rows))


def _answer(drawn: Drawn) -> dict[str, Any]:
    """One diagnosis, scored."""
    began = time.perf_counter()
    diagnosis, found = diagnose_experiment(drawn.folder / "experiment.toml", drawn.folder / "out", _silent)
    truth, named = set(drawn.label["effects"]), {effect["id"]: effect for effect in found["effects"]}
    credited = {name: {name, *effect["equivalent"]} for name, effect in named.items()}
    hit = {item for item in truth if any(item in group for group in credited.values())}
    inside = [
        spread["low"] <= drawn.label["effects"][item][name] <= spread["high"]
        for item in truth & set(named)
        for name, spread in named[item]["parameters"].items()
        if not name.endswith(("azimuth_deg", "phase_deg", "direction_deg"))
    ]
    gap = found["gap"] or {}
    seconds = time.perf_counter() - began
    label = dict(drawn.label)
    sigmas = {
        name: visible_sigmas(diagnosis, shift, label["effects"].keys() - {name})
        for name, shift in label["shifts"].items()
    }
    outside = label.pop("shifts").get(label["outside"])
    return {
        **label,
        "proposed": found["next_experiment"],
        "verdict": found["verdict"],
        "named": sorted(named),
        "chosen": " + ".join(sorted(diagnosis.chosen)) or "no effect",
        "exact": found["verdict"] == "effect" and truth == set(named),
        "credit": found["verdict"] == "effect" and hit == truth and len(named) == len(truth),
        "inside": inside,
        "gap": gap["after"]["held_out"] / gap["noise_floor"] if gap and gap["after"]["held_out"] else float("nan"),
        "sigmas": sigmas,
        "beyond": 0.0 if outside is None else sigmas_beyond_named(diagnosis, outside),
        "seconds": seconds,
    }


def _silent(what: str, share: float) -> None:
    del what, share


def _line(row: dict[str, Any]) -> str:
    sizes = {key: {k: float(f"{v:.3g}") for k, v in values.items()} for key, values in row["effects"].items()}
    truth = row["outside"] + f" {row['size']:.3g}" if row["outside"] else json.dumps(sizes)
    return (
        f"{row['kind']:8} {truth} -> {row['verdict']} {row['named']} credit={row['credit']} "
        f"inside={sum(row['inside'])}/{len(row['inside'])} gap={row['gap']:.2f} "
        f"visible={min(row['sigmas'].values(), default=0.0):.1f} beyond={row['beyond']:.1f} {row['seconds']:.0f} s"
    ) + _next_line(row)


def _next_line(row: dict[str, Any]) -> str:
    if "next" not in row:
        return ""
    then, count = row["next"], sum(run["times"] for run in row["proposed"]["runs"])
    return (
        f"\n         or {list(row['proposed']['separation_sigmas'])}? {count} runs made -> {then['verdict']} "
        f"{then['named']} right={_right(then)}, resolved={_resolved(row)}"
    )


def _resolved(row: dict[str, Any]) -> bool:
    """Whether the runs that were made ended the ambiguity: no two of the models they were to separate remain."""
    then = row["next"]
    asked = {row["chosen"], *row["proposed"]["separation_sigmas"]}
    again = then["proposed"] or {"separation_sigmas": {}, "inseparable_sigmas": {}}
    left = {then["chosen"], *again["separation_sigmas"], *again["inseparable_sigmas"]}
    return len(asked & left) < 2


def _right(row: dict[str, Any]) -> bool:
    """Whether an answer is the one that more data should bring: the effects exactly, none, or unknown."""
    if row["kind"] in {"clean", "outside"}:
        return bool(row["verdict"] == ("none" if row["kind"] == "clean" else "unknown"))
    return bool(row["exact"])


def _share(hits: int, count: int) -> str:
    if not count:
        return "-"
    interval = stats.binomtest(hits, count).proportion_ci()
    return f"{hits}/{count} = {hits / count:.1%} ({interval.low:.1%} to {interval.high:.1%})"


def table(rows: list[dict[str, Any]]) -> str:
    def of(kind: str) -> list[dict[str, Any]]:
        return [row for row in rows if row["kind"] == kind]

    def verdicts(part: list[dict[str, Any]], verdict: str) -> str:
        return _share(sum(row["verdict"] == verdict for row in part), len(part))

    clean, single, pair, outside = of("clean"), of("single"), of("pair"), of("outside")
    inside = [value for row in rows for value in row["inside"]]

    def seen(part: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [row for row in part if min(row["sigmas"].values()) > DETECTABLE_SIGMAS]

    beyond = [row for row in outside if row["beyond"] > DETECTABLE_SIGMAS]
    asked = [row for row in rows if "next" in row]
    gaps = [row["gap"] for row in single + pair if row["credit"] and np.isfinite(row["gap"])]
    return "\n".join(
        [
            "",
            f"false alarms on clean data      {_share(sum(row['verdict'] != 'none' for row in clean), len(clean))}",
            f"singles named, exact            {_share(sum(row['exact'] for row in single), len(single))}",
            f"singles named, with equivalents {_share(sum(row['credit'] for row in single), len(single))}",
            f"  of those visible at 5 sigmas  {_share(sum(row['credit'] for row in seen(single)), len(seen(single)))}",
            f"singles taken for none          {verdicts(single, 'none')}",
            f"pairs, both named               {_share(sum(row['credit'] for row in pair), len(pair))}",
            f"  of those visible at 5 sigmas  {_share(sum(row['credit'] for row in seen(pair)), len(seen(pair)))}",
            f"outside called unknown          {verdicts(outside, 'unknown')}",
            f"outside misnamed                {verdicts(outside, 'effect')}",
            f"  visible at 5 sigmas: unknown  {verdicts(seen(outside), 'unknown')}",
            f"  visible at 5 sigmas: misnamed {verdicts(seen(outside), 'effect')}",
            f"  5 sigmas beyond named: unknown {verdicts(beyond, 'unknown')}",
            f"  5 sigmas beyond named: misnamed {verdicts(beyond, 'effect')}",
            f"95 % intervals that cover       {_share(sum(inside), len(inside))}",
            f"gap held out   / noise floor    {np.median(gaps):.3f}, 90 % {np.quantile(gaps, 0.9):.3f}" if gaps else "",
            f"proposed runs, right before     {_share(sum(map(_right, asked)), len(asked))}" if asked else "",
            f"  right once they were made     {_share(sum(_right(row['next']) for row in asked), len(asked))}",
            f"  ambiguity resolved            {_share(sum(map(_resolved, asked)), len(asked))}",
            f"seconds per experiment          median {np.median([row['seconds'] for row in rows]):.0f}",
        ]
    )


if __name__ == "__main__":
    main()
