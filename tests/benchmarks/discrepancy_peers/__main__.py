"""turnscope beside SINDy, a Gaussian process and stepwise regression on the same blind experiments of the second world.

    python -m tests.benchmarks.discrepancy_peers --seed SEED --keep FOLDER

Needs the extra `bench`. Experiments are those of tests/laboratory with [known_to] tables; every method gets the cleaned
marks, the commands, the robot file, what is known to within a tolerance and the simulator, and may fit the same runs.
turnscope runs as a command in a process of its own. Begun again with one --keep, it continues where it stopped.
ODR-BINDy has no package on PyPI (looked for on 23 November 2026) and is left out.
"""

from __future__ import annotations

import argparse
import json
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evaluator.diagnosis.assessment.gap import run_gaps
from evaluator.diagnosis.likelihood.linear.random_effects import place_starts
from simulator.robot import load_robot
from tests.benchmarks.discrepancy_peers.gaussian_process import gaussian_process
from tests.benchmarks.discrepancy_peers.inputs import Inputs, gaps_mm, read, with_robot
from tests.benchmarks.discrepancy_peers.sindy import sindy
from tests.benchmarks.discrepancy_peers.stepwise import stepwise
from tests.benchmarks.discrepancy_peers.table import table
from tests.benchmarks.laboratory import diagnosed, folder_of, generator_digest
from tests.laboratory import mess, outside
from tests.laboratory.experiment import EFFECTS

PEERS: Mapping[str, Callable[[Inputs], dict[str, Any]]] = {
    "SINDy": sindy,
    "Gaussian process": gaussian_process,
    "stepwise BIC": stepwise,
}


def main() -> None:
    """Draw, let every method answer, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.discrepancy_peers", description=__doc__)
    for name, count in (("messes", 4), ("singles", 5), ("pairs", 2), ("outside", 1)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, required=True, help="of everything that is drawn")
    parser.add_argument("--keep", type=Path, required=True, help="folder for experiments, truths and rows.jsonl")
    chosen = parser.parse_args()
    chosen.known_to = True
    chosen.keep.mkdir(parents=True, exist_ok=True)
    print(table(rows_of(keys(chosen), chosen)))


def keys(chosen: argparse.Namespace) -> list[str]:
    """What to draw, as "kind/name/number": the whole mess first, then kinds drawn from the seed."""
    rng = np.random.default_rng(chosen.seed)
    messes = ["everything", *rng.permutation([name for name in mess.KINDS if name != "everything"])]
    parts = [
        [f"mess/{name}/0" for name in messes[: chosen.messes]],
        [f"single/{name}/0" for name in rng.permutation(EFFECTS)[: chosen.singles]],
        [f"pair//{k}" for k in range(chosen.pairs)],
        [f"outside/{name}/0" for name in rng.permutation(list(outside.KINDS))[: chosen.outside]],
    ]
    placed = [((k + 0.5) / len(part), key) for part in parts for k, key in enumerate(part)]
    return [key for _, key in sorted(placed, key=lambda pair: pair[0])]


def rows_of(wanted: list[str], chosen: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of all wanted experiments; those that rows.jsonl has already are read from there."""
    file = chosen.keep / "rows.jsonl"
    label = f"{chosen.seed}-{generator_digest()}"
    old = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["key"]: row for row in old if row["label"] == label}
    for key in wanted:
        if key not in rows:
            rows[key] = {"key": key, "label": label, **answers(key, chosen)}
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[key]) + "\n")
            print(key, {name: item.get("named") for name, item in rows[key]["methods"].items()}, flush=True)
    return [rows[key] for key in wanted]


def answers(key: str, chosen: argparse.Namespace) -> dict[str, Any]:
    """One experiment: the truth, and what every method says of it."""
    row = diagnosed(key, chosen, chosen.keep)
    folder = folder_of(key, chosen, chosen.keep)
    inputs = read(folder / "experiment.toml")
    methods: dict[str, dict[str, Any]] = {"turnscope": _turnscope(row, folder, inputs)}
    for name, method in PEERS.items():
        began = time.perf_counter()
        try:
            methods[name] = method(inputs)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # no answer is an answer; the rest goes on
            methods[name] = {"failed": traceback.format_exc(limit=3)}
        methods[name]["seconds"] = time.perf_counter() - began
    runs = list(inputs.aside)
    starts = place_starts(inputs.problem, inputs.nominal, runs)
    pose = float(np.sqrt(np.mean(run_gaps(inputs.problem, starts, runs) ** 2)))
    before = {"pose": pose, "predicted": gaps_mm(inputs, inputs.path_from)["predicted"]}
    return {"truth": row["truth"], "right": row["right"], "runs": row["runs"], "before": before, "methods": methods}


def _turnscope(row: Mapping[str, Any], folder: Path, inputs: Inputs) -> dict[str, Any]:
    """What the command line answered: in its own words, and with its robot file under the gaps of the others."""
    path = folder / "out" / "diagnosis.json"
    answer = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}  # stopped: no answer
    gap = answer.get("gap") or {}
    own = {when: (gap.get(when) or {}).get("held_out") for when in ("before", "after")}
    predicted = ((gap.get("predicted") or {}).get("after") or {}).get("held_out")
    found = folder / "out" / "robot_with_effect.toml"
    robot = load_robot(found) if found.exists() and row["named"] else None
    same = with_robot(inputs, robot) if robot else inputs
    runs = list(inputs.aside)
    starts = place_starts(same.problem, same.nominal, runs)
    pose = float(np.sqrt(np.mean(run_gaps(same.problem, starts, runs) ** 2)))
    return {
        "verdict": row["verdict"],
        "named": row["named"],
        "credited": {e["id"]: [e["id"], *e.get("equivalent", [])] for e in answer.get("effects", []) if "id" in e},
        "alarm": bool(row["named"]),
        "gap": {"pose": pose, "predicted": predicted, "own_before": own["before"], "own_after": own["after"]},
        "seconds": row["seconds"],
    }


if __name__ == "__main__":
    main()
