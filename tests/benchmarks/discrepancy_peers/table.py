"""The table: what each method said, beside the truth."""

from __future__ import annotations

from typing import Any

import numpy as np

METHODS = ("turnscope", "SINDy", "Gaussian process", "stepwise BIC")
NAMELESS = "Gaussian process"  # it has no verdict and no names


def table(rows: list[dict[str, Any]]) -> str:
    """Counts, gaps and times of every method; what it said of each experiment."""
    lines = [f"{'':58s}" + "".join(f"{name:>18s}" for name in METHODS)]
    kinds = {kind: [r for r in rows if r["truth"]["kind"] == kind] for kind in ("mess", "single", "pair", "outside")}
    lines.append(_counted("untidy, nothing to find: an effect named", kinds["mess"], _named))
    lines.append(_counted("untidy, nothing to find: anything found", kinds["mess"], _alarmed))
    for kind in ("single", "pair"):
        lines.append(_counted(f"{kind}: named, and nothing else", kinds[kind], _exact))
        lines.append(_counted(f"{kind}: a true effect named first", kinds[kind], _first))
    lines.append(_counted("outside physics: an effect named", kinds["outside"], _named))
    hidden = [r for r in rows if r["truth"]["kind"] != "mess"]
    for which, part in (("hidden physics", hidden), ("nothing hidden", kinds["mess"])):
        for gap, words in (("pose", "start pose fitted"), ("predicted", "predicted")):
            before = np.median([r["before"][gap] for r in part]) if part else np.nan
            what = f"gap, {words}, {which}, µm (before: {1e3 * before:.1f})"
            lines.append(_cells(what, [_median_um(part, name, gap) for name in METHODS]))
    lines.append(_cells("seconds, median", [f"{np.median(_seconds(rows, name)):.0f}" for name in METHODS]))
    lines.append(_cells("seconds, worst", [f"{max(_seconds(rows, name)):.0f}" for name in METHODS]))
    return "\n".join([*lines, "", *(_line(row) for row in rows)])


def _cells(what: str, cells: list[str]) -> str:
    return f"{what:58s}" + "".join(f"{cell:>18s}" for cell in cells)


def _counted(what: str, rows: list[dict[str, Any]], test: Any) -> str:
    cells = ["-" if name == NAMELESS else f"{sum(test(r, name) for r in rows)} of {len(rows)}" for name in METHODS]
    return _cells(what, cells)


def _names(row: dict[str, Any], method: str) -> list[str]:
    return list(row["methods"][method].get("named") or [])


def _named(row: dict[str, Any], method: str) -> bool:
    return bool(_names(row, method))


def _alarmed(row: dict[str, Any], method: str) -> bool:
    said = row["methods"][method]
    return bool(said.get("alarm")) or said.get("verdict") == "unknown"


def _exact(row: dict[str, Any], method: str) -> bool:
    if method == "turnscope":
        return bool(row["right"])
    return sorted(_names(row, method)) == sorted(row["truth"]["effects"])


def _first(row: dict[str, Any], method: str) -> bool:
    """turnscope names no order: any of its effects counts where there are two, as the first of the others does."""
    names = _names(row, method)[: None if method == "turnscope" else 1]
    credited = row["methods"][method].get("credited", {})
    return any(set(credited.get(name, [name])) & set(row["truth"]["effects"]) for name in names)


def _median_um(rows: list[dict[str, Any]], method: str, gap: str) -> str:
    values = [(row["methods"][method].get("gap") or {}).get(gap) for row in rows]
    known = [value for value in values if value is not None and np.isfinite(value)]
    missing = f" ({len(values) - len(known)} none)" if len(known) < len(values) else ""
    return f"{1e3 * np.median(known):.1f}{missing}" if known else "-"


def _seconds(rows: list[dict[str, Any]], method: str) -> list[float]:
    return [row["methods"][method]["seconds"] for row in rows]


def _line(row: dict[str, Any]) -> str:
    said = []
    for name in METHODS:
        answer = row["methods"][name]
        gap = answer.get("gap") or {}
        numbers = " ".join(f"{1e3 * v:.0f}" if v is not None else "-" for v in (gap.get("pose"), gap.get("predicted")))
        names = "failed" if "failed" in answer else "+".join(answer.get("named") or []) or answer.get("verdict", "-")
        said.append(f"{name}: {names} [{numbers}]")
    before = " ".join(f"{1e3 * row['before'][name]:.0f}" for name in ("pose", "predicted"))
    return f"{row['key']} {'+'.join(row['truth']['effects'])} [{before}]; " + "; ".join(said)
