"""The second world judges the diagnosis: `python -m tests.benchmarks.laboratory --messes 24 --seeds 10 --workers 2`.

Experiments of tests/laboratory are written as files, diagnosed by the command line in a process of its own, and scored
against truths that lie in another folder. With --keep an interrupted run continues where it stopped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from simulator.effects.catalogue import BUILT_IN
from tests.benchmarks.laboratory_table import line, table
from tests.laboratory import mess, odd, outside
from tests.laboratory.disagreement import Item, disagreements
from tests.laboratory.experiment import EFFECTS, draw, write

ROOT = Path(__file__).parents[2]
LONGEST_S = 900  # a diagnosis that takes longer is stopped and counted as no answer
ANGLES = ("azimuth_deg", "phase_deg", "direction_deg")  # periodic: no rank without a branch


def main() -> None:
    """Draw, diagnose, score, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.laboratory", description=__doc__)
    parser.add_argument("--messes", type=int, default=len(mess.KINDS), help="kinds of mess (default: all)")
    parser.add_argument("--seeds", type=int, default=1, help="experiments of each kind of mess")
    for name, what in (
        ("singles", "experiments with one effect under the whole mess"),
        ("pairs", "with two effects"),
        ("outside", "with physics that no effect has"),
        ("odd", "untidy experiments with one odd run"),
    ):
        parser.add_argument(f"--{name}", type=int, default=0, help=what)
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--workers", type=int, default=1, help="diagnoses at a time, each in one process")
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no further experiment after so many minutes")
    parser.add_argument("--known-to", action="store_true", help="write [known_to] tables too")
    parser.add_argument("--pivots", action="store_true", help="let three runs of each experiment turn on the spot")
    parser.add_argument("--keep", type=Path, help="folder for experiments, truths and rows.jsonl; continues there")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print(table(run_all(keys(chosen), chosen, folder)))


def keys(chosen: argparse.Namespace) -> list[str]:
    """What to draw, as "kind/name/number", kinds interleaved so that an early stop has seen some of each."""
    kinds = [
        [f"mess/{name}/{i}" for i in range(chosen.seeds) for name in list(mess.KINDS)[: chosen.messes]],
        [f"odd/{list(odd.KINDS)[i % len(odd.KINDS)]}/{i // len(odd.KINDS)}" for i in range(chosen.odd)],
        [f"single/{EFFECTS[i % len(EFFECTS)]}/{i // len(EFFECTS)}" for i in range(chosen.singles)],
        [f"pair//{i}" for i in range(chosen.pairs)],
        [
            f"outside/{list(outside.KINDS)[i % len(outside.KINDS)]}/{i // len(outside.KINDS)}"
            for i in range(chosen.outside)
        ],
    ]
    placed = [((i + 0.5) / len(part), key) for part in kinds for i, key in enumerate(part)]
    return [key for _, key in sorted(placed, key=lambda pair: pair[0])]


def run_all(wanted: list[str], chosen: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """Rows of all wanted experiments; those that rows.jsonl has already are read from there."""
    file, ends = folder / "rows.jsonl", time.monotonic() + 60 * chosen.minutes
    label = f"{chosen.seed}{'k' * chosen.known_to}{'p' * chosen.pivots}-{generator_digest()}"
    old = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["key"]: row for row in old if row["label"] == label}

    def one(key: str) -> None:
        if key in rows or time.monotonic() > ends:
            return
        row = {"key": key, "label": label, **diagnosed(key, chosen, folder)}
        rows[key] = row
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
        print(line(row), flush=True)

    with ThreadPoolExecutor(chosen.workers) as pool:
        list(pool.map(one, wanted))
    return [rows[key] for key in wanted if key in rows]


def generator_digest() -> str:
    """Of the laboratory's code: rows of another generator are not taken for this one's."""
    files = [file for file in sorted((ROOT / "tests" / "laboratory").glob("*.py")) if not file.name.startswith("test_")]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]


def folder_of(key: str, chosen: argparse.Namespace, folder: Path) -> Path:
    """Where an experiment is written; the name says nothing of what is hidden in it."""
    return folder / "experiments" / _digest(key, chosen).hex()[:10]


def _digest(key: str, chosen: argparse.Namespace) -> bytes:
    return hashlib.sha256(f"{chosen.seed}/{key}".encode()).digest()


def diagnosed(key: str, chosen: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Draw one experiment, write its files, diagnose them, score the answer."""
    kind, name, _ = key.split("/")
    digest, where = _digest(key, chosen), folder_of(key, chosen, folder)
    for attempt in range(5):
        shutil.rmtree(where, ignore_errors=True)
        rng = np.random.default_rng([*digest, *[attempt] * bool(attempt)])
        try:
            drawn = draw(kind, name, rng, pivots=chosen.pivots)
            write(drawn, where, folder / "truths", rng, known_to=chosen.known_to)
        except ArithmeticError:  # effects so large together that the robot finds no balance: draw again
            continue
        break
    else:
        raise ArithmeticError(f"{key}: five draws without a balance of forces")
    began = time.perf_counter()
    answer, message = diagnosis_of(where)
    seconds = time.perf_counter() - began
    where_true = [] if kind == "odd" or not answer else disagreements(drawn.session, np.random.default_rng(digest[0]))
    found = {"where": counted(where_true, answer.get("disagrees", []))}
    return {**scored(drawn.truth, answer), **found, "runs": drawn.session.runs, "seconds": seconds, "message": message}


def diagnosis_of(where: Path) -> tuple[dict[str, Any], str]:
    """Diagnose the experiment of a folder as a user would: its diagnosis.json, and what went wrong."""
    message = ""
    try:
        done = called("diagnose", str(where / "experiment.toml"), "-o", str(where / "out"), "-q", "--workers", "1")
        message = "" if done.returncode == 0 else f"exit {done.returncode}: {done.stderr.strip()[-300:]}"
    except subprocess.TimeoutExpired:
        message = f"no answer within {LONGEST_S} s"
    path = where / "out" / "diagnosis.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}, message


def called(*words: str) -> subprocess.CompletedProcess[str]:
    """A command of turnscope in a process of its own, on one core."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    return subprocess.run(
        [sys.executable, "-m", "evaluator", *words],
        cwd=ROOT, env={**os.environ, **threads}, capture_output=True, text=True, timeout=LONGEST_S, check=False,
    )  # fmt: skip


def counted(true: Sequence[Item], said: Sequence[dict[str, Any]]) -> list[int]:
    """Phases of runs and quantities that disagree: rightly said, said without reason, not said."""
    known, named = set(true), {(item["run"], item["phase"], item["quantity"]) for item in said}
    return [len(known & named), len(named - known), len(known - named)]


def limits_that_hold(truth: dict[str, Any], answer: dict[str, Any]) -> list[bool]:
    """Whether each limit of an effect that is not named contains its true size; of those that can fail."""
    found = []
    for item in answer.get("limits", []):
        effect, parameter = item["id"], item["parameter"]
        declared = BUILT_IN[effect].parameter(parameter)
        assert declared is not None
        true = truth["effects"].get(effect, {}).get(parameter, declared.absent)
        if true != declared.absent or None not in (item["low"], item["high"]):
            low, high = (
                -np.inf if item["low"] is None else item["low"],
                np.inf if item["high"] is None else item["high"],
            )
            found.append(bool(low <= true <= high))
    return found


def scored(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    """What an answer says and how it compares with the truth."""
    effects = {effect["id"]: effect for effect in answer.get("effects", []) if "id" in effect}
    verdict = answer.get("verdict", "no answer")
    named = sorted(effects) if verdict == "effect" else []
    credit = {name: {name, *effects[name].get("equivalent", [])} for name in named}
    true = set(truth["effects"])
    right = len(named) == len(true) and all(any(t in credit[n] for n in named) for t in true) and bool(true)
    ranks, covered = [], []
    for name in true & set(named):
        for parameter, value in truth["effects"][name].items():
            spread = effects[name]["parameters"].get(parameter)
            if spread and None not in spread.values() and not parameter.endswith(ANGLES):
                sigma = max((spread["high"] - spread["low"]) / 3.92, 1e-300)
                ranks.append([f"{name}.{parameter}", float(stats.norm.cdf((value - spread["value"]) / sigma))])
                covered.append(bool(spread["low"] <= value <= spread["high"]))
    mistakes = answer.get("mistakes", [])
    gap = answer.get("gap") or {}
    wanted = truth["odd"] or {"runs": [], "kinds": []}
    hit = [
        m
        for m in mistakes
        if set(m["runs"]) & set(wanted["runs"])
        and {m["kind"], *m.get("equivalent_kinds", [])} & set(wanted["kinds"])  # or what it is said to be alike
    ]
    pinned = {run for m in hit for run in m["runs"]}
    return {
        "truth": truth,
        "verdict": verdict,
        "named": named,
        "said": {name: {p: v["value"] for p, v in effects[name]["parameters"].items()} for name in named},
        "unusual": sorted(set(effects) - set(named)),
        "right": bool(right),
        "odd_named": bool(truth["odd"]) and pinned == set(wanted["runs"]),
        "false_mistakes": [m for m in mistakes if not set(m["runs"]) & set(wanted["runs"])],
        "ranks": ranks,
        "covered": covered,
        "limits": limits_that_hold(truth, answer),
        "gap": {key: (gap.get(key) or {}).get("held_out") for key in ("before", "after")},
        "noise_floor": gap.get("noise_floor"),
    }


if __name__ == "__main__":
    main()
