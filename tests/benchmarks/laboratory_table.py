"""The table of the laboratory benchmark: what was answered beside what was asked, from the rows of its experiments."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from scipy import stats

from tests.laboratory import mess


def line(row: dict[str, Any]) -> str:
    """One experiment, as it is done."""
    sizes = {
        effect: {name: float(f"{value:.3g}") for name, value in values.items()}
        for effect, values in row["truth"]["effects"].items()
    }
    extra = f" {json.dumps(sizes)}" if sizes else ""
    said = {name: {p: float(f"{v:.6g}") for p, v in values.items()} for name, values in row["said"].items()}
    named = f" {json.dumps(said)}" if said else ""
    return f"{row['key']:42} {row['verdict']}{named} {row['seconds']:.0f} s{extra} {row['message']}".rstrip()


def share(hits: int, count: int) -> str:
    """A share with its 95 % interval."""
    if not count:
        return "-"
    interval = stats.binomtest(hits, count).proportion_ci()
    return f"{hits}/{count} = {hits / count:.0%} ({interval.low:.0%} to {interval.high:.0%})"


def table(rows: list[dict[str, Any]]) -> str:
    """All figures beside their thresholds."""
    parts = {
        kind: [r for r in rows if r["truth"]["kind"] == kind] for kind in ("mess", "odd", "single", "pair", "outside")
    }
    lines = ["", *_messes(parts["mess"]), "", *_odds(parts["odd"]), ""]
    for kind, wanted in (("single", "95 %"), ("pair", "85 %")):
        part = parts[kind]
        matter = [r for r in part if all(size["matters"] for size in r["truth"]["sizes"].values())]
        lines.append(
            f"{kind}s named, or a stated equivalent  {share(sum(r['right'] for r in part), len(part))}  [{wanted}]"
        )
        lines.append(f"  of those larger than the mess     {share(sum(r['right'] for r in matter), len(matter))}")
        lines += [f"  missed: {_truth(r)} -> {r['verdict']} {r['named']}" for r in part if not r["right"]]
    part = parts["outside"]
    lines.append(
        f"outside physics called unknown       {share(sum(r['verdict'] == 'unknown' for r in part), len(part))}  [90 %]"
    )
    lines.append(f"outside physics misnamed             {share(sum(bool(r['named']) for r in part), len(part))}  [2 %]")
    lines += [f"  {r['truth']['name']} -> {r['verdict']} {r['named']}" for r in part if r["verdict"] != "unknown"]
    return "\n".join([*lines, "", *_where(rows), *_ranks(rows), *_gaps(rows), *_times(rows)])


def _truth(row: dict[str, Any]) -> str:
    return " + ".join(row["truth"]["effects"])


def _messes(part: list[dict[str, Any]]) -> list[str]:
    lies = [r for r in part if r["named"]]
    lines = [f"untidy laboratories, an effect named (lie)   {share(len(lies), len(part))}  [none]"]
    for name in dict.fromkeys(r["truth"]["name"] for r in part):
        mine = [r for r in part if r["truth"]["name"] == name]
        grain = mess.NAMESAKES.get(name, set())
        told = [" + ".join(n + ("*" if n in grain else "") for n in r["named"]) for r in mine if r["named"]]
        verdicts = {v: sum(r["verdict"] == v for r in mine) for v in dict.fromkeys(r["verdict"] for r in mine)}
        said = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        lines.append(f"  {name:32} {said:28} {'; '.join(told)}")
    wrong = sum(bool(r["false_mistakes"]) for r in part)
    return [
        *lines,
        "  * the effect says what was untidy",
        f"runs called mistaken without reason  {share(wrong, len(part))}",
    ]


def _odds(part: list[dict[str, Any]]) -> list[str]:
    lines = [f"odd run named, with its kind         {share(sum(r['odd_named'] for r in part), len(part))}  [95 %]"]
    for r in part:
        found = "named" if r["odd_named"] else "not named"
        lines.append(f"  {r['truth']['name']:18} {found:10} {r['verdict']} {r['named']} {r['message'][:110]}")
    return [
        *lines,
        f"  an effect named beside it         {share(sum(bool(r['named']) for r in part), len(part))}  [none]",
    ]


def _where(rows: list[dict[str, Any]]) -> list[str]:
    """F1 over phases of runs and quantities, of all experiments together that were answered and have no odd run."""
    counts = np.array([r["where"] for r in rows if r["truth"]["kind"] != "odd" and r["verdict"] != "no answer"])
    right, wrong, missed = counts.reshape(-1, 3).sum(axis=0)
    if not right + missed:
        return ["runs and phases that disagree        -"]
    f1 = 2 * right / (2 * right + wrong + missed)
    said = f"{right} rightly, {wrong} without reason, {missed} missed"
    return [f"runs and phases that disagree, F1    {f1:.2f} ({said})  [0.9]"]


def _ranks(rows: list[dict[str, Any]]) -> list[str]:
    ranks = [(name, rank) for r in rows for name, rank in r["ranks"]]
    inside = [value for r in rows for value in r["covered"]]
    lines = [f"95 % intervals that cover            {share(sum(inside), len(inside))}"]
    if len(ranks) >= 5:
        test = stats.kstest([rank for _, rank in ranks], "uniform")
        lines.append(f"ranks of all parameters uniform      p = {test.pvalue:.3g} ({len(ranks)} ranks)  [p > 0.05]")
    for name in dict.fromkeys(name for name, _ in ranks):
        mine = [rank for other, rank in ranks if other == name]
        if len(mine) >= 5:
            lines.append(f"  {name:40} p = {stats.kstest(mine, 'uniform').pvalue:.3g} ({len(mine)})")
    holding = [value for r in rows if r["truth"]["kind"] != "outside" for value in r["limits"]]
    return [*lines, f"limits of effects not named that hold {share(sum(holding), len(holding))}  [95 %]"]


def _gaps(rows: list[dict[str, Any]]) -> list[str]:
    gaps = [(r["gap"]["before"], r["gap"]["after"], r["noise_floor"]) for r in rows if r["right"]]
    gaps = [gap for gap in gaps if None not in gap]
    if not gaps:
        return ["gap of held-out runs, where right: -"]
    before, after, floor = np.median(gaps, axis=0)
    return [
        f"gap of held-out runs, where right    {before:.4f} -> {after:.4f} mm, noise floor {floor:.4f} mm (medians)"
    ]


def _times(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return ["nothing was diagnosed"]
    seconds, scaled = [r["seconds"] for r in rows], [r["seconds"] * 24 / r["runs"] for r in rows]
    failed = sum(r["verdict"] == "no answer" for r in rows)
    return [
        (
            f"seconds per experiment               median {np.median(seconds):.0f}, worst {max(seconds):.0f}; "
            f"scaled to 24 runs {np.median(scaled):.0f} and {max(scaled):.0f}  [10 and 60]"
        ),
        f"no answer                            {share(failed, len(rows))}",
    ]
