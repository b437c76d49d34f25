"""Routes of the screens Results, Diagnosis and Sandbox."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.workflow import (
    Edit,
    body_mm,
    diagnosis_view,
    edit_experiment,
    effect_sliders,
    effects_of,
    new_experiment,
    new_table,
    out_folder,
    own_effects_for,
    read_experiment,
    read_unfinished,
    results_view,
    robot_file,
    robot_sliders,
    sandbox_motions,
    with_effects,
    write_mended,
    write_robot,
)

MOST_EFFECTS = 40  # of a request: more than the catalogue has


def routes(studio: Studio) -> list[Route]:
    """Routes of these screens."""
    one = "/api/experiments/{id}"
    return [
        Route(one + "/results", endpoint(studio, measured)),
        Route(one + "/diagnosis", endpoint(studio, diagnosis)),
        Route(one + "/robot", endpoint(studio, add_effect), methods=["POST"]),
        Route(one + "/mend", endpoint(studio, mend), methods=["POST"]),
        Route(one + "/mended", endpoint(studio, write_mended_copy), methods=["POST"]),
        Route(one + "/next", endpoint(studio, write_next), methods=["POST"]),
        Route("/api/sandbox", endpoint(studio, sliders)),
        Route("/api/sandbox", endpoint(studio, motions), methods=["POST"]),
    ]


def measured(studio: Studio, asked: Asked) -> Json:
    """Measured and simulated runs."""
    found = results_view(studio.folder.path(asked.path["id"]))
    return {"name": found.name, "runs": found.runs, "gap_mm": found.gap_mm}


def diagnosis(studio: Studio, asked: Asked) -> Json:
    """The last diagnosis, with numbers and sentences."""
    path = studio.folder.path(asked.path["id"])
    found = diagnosis_view(path)
    result: Json = {
        "content": found.content,
        "pieces": found.pieces,
        "can_add": bool(found.robot_with_effect),
        "lines": [],
        "parameters": {},
    }
    if found.content is not None:
        from evaluator.report.verdict import verdict_lines

        result["lines"] = verdict_lines(found.content)
        named = {effect["id"] for effect in found.content["effects"]}
        result["parameters"] = {
            one.id: {slider.key: {"words": slider.words, "unit": slider.unit} for slider in one.sliders}
            for one in effect_sliders(path)
            if one.id in named
        }
    robot = robot_file(path)
    in_robot = effects_of(path)
    return {
        **result,
        "in_robot": in_robot,
        "robot": {"path": _shown(studio, robot.path), "version": robot.version, "named": robot.named},
    }


def add_effect(studio: Studio, asked: Asked) -> Json:
    """Add effects to the experiment's robot: those of the diagnosis, or those of the request."""
    path = studio.folder.path(asked.path["id"])
    target = studio.folder.inside(robot_file(path).path)
    effects = asked.body.get("effects")
    if effects is None:
        text = diagnosis_view(path).robot_with_effect
        if not text:
            raise InputError("the diagnosis found no effect that could be added")
    else:
        text = with_effects(path, _effects(effects))

    def change() -> None:
        write_robot(path, text, asked.text("version"))

    beside = [studio.folder.inside(file) for file in own_effects_for(target, text)]
    studio.history.record([target, path, *beside], "an effect in the robot", change)
    return diagnosis(studio, asked)


def mend(studio: Studio, asked: Asked) -> Json:
    """Correct a mistake by changing commands."""
    path = studio.folder.path(asked.path["id"])
    table = read_experiment(path)
    kind, runs = asked.text("mistake"), asked.body.get("runs")
    if kind not in ("reversed", "sides-swapped") or not isinstance(runs, list):
        raise InputError(f"{kind}: this mistake is not mended by a change of commands; look at the run")
    edits = []
    for row, run in enumerate(table.rows):
        if run.get("id") in runs and {"left_rpm", "right_rpm"} <= run.keys():
            left, right = float(run["left_rpm"]), float(run["right_rpm"])
            left, right = (-left, -right) if kind == "reversed" else (right, left)
            edits += [Edit("set", row, "left_rpm", left), Edit("set", row, "right_rpm", right)]
    if not edits:
        raise InputError("these runs are not in the experiment any more")
    studio.history.record([path], "mended commands", lambda: edit_experiment(path, table.version, edits))
    return {"changed": len(edits) // 2}


def write_mended_copy(studio: Studio, asked: Asked) -> Json:
    """Write the experiment with all mistakes of its runs corrected, as a new file beside it."""
    path = studio.folder.path(asked.path["id"])
    mended = write_mended(path, out_folder(path))
    if mended is None:
        raise InputError("no run shows a mistake any more; diagnose again")
    target = studio.folder.inside(mended.path)
    shown = {"id": studio.folder.id_of(target), "path": studio.folder.relative(target)}
    return {**shown, "changes": list(mended.changes)}


def write_next(studio: Studio, asked: Asked) -> Json:
    """Write the proposed further runs as a new experiment, ready to be recorded."""
    path = studio.folder.path(asked.path["id"])
    content = diagnosis_view(path).content or {}
    runs = (content.get("next_experiment") or {}).get("runs") or []
    if not runs:
        raise InputError("the diagnosis proposes no further runs")
    target = studio.folder.inside(path.parent / f"{path.parent.name}-next")
    number_ = 2
    while target.exists():
        target, number_ = target.with_name(f"{path.parent.name}-next-{number_}"), number_ + 1
    new_experiment(target)
    experiment = target / "experiment.toml"
    new_table(experiment, f"{read_experiment(path).head.get('name', path.stem)}: next runs", "robot.toml", [])
    robot = robot_file(path)
    if robot.named:
        (target / "robot.toml").write_text(robot.path.read_text(encoding="utf-8"), encoding="utf-8")
    edits, count = [], 0
    for run in runs:
        for _ in range(int(run["times"])):
            count += 1
            place = f"x {run['x_mm']:g} mm, y {run['y_mm']:g} mm, heading {run['heading_deg']:g} deg"
            note = f"start at {place}; drive for {run['duration_s']:g} s"
            values = {"id": f"n{count:02d}", "left_rpm": run["left_rpm"], "right_rpm": run["right_rpm"], "start_s": 0.5}
            edits.append(Edit("add", values={**values, "video": f"n{count:02d}.mp4", "notes": note}))
    edit_experiment(experiment, read_experiment(experiment).version, edits)
    return {"id": studio.folder.id_of(experiment), "path": studio.folder.relative(experiment)}


def sliders(studio: Studio, asked: Asked) -> Json:
    """Sliders of a robot and of all effects. experiment: id of the one with the initial robot and commands."""
    robot, path = _robot(studio, asked.query)
    result: Json = {"robot": [vars(one) for one in robot_sliders(robot)], "commands": _commands(path)}
    result["effects"] = [
        {**vars(one), "sliders": [vars(slider) for slider in one.sliders]} for one in effect_sliders(path)
    ]
    result["in_robot"] = effects_of(path) if path is not None else []
    result["version"] = robot_file(path).version if path is not None else ""
    return result


def motions(studio: Studio, asked: Asked) -> Json:
    """Paths with and without the changes."""
    robot, _ = _robot(studio, asked.body)
    commands = asked.body.get("commands")
    if not isinstance(commands, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in commands):
        raise InputError("commands: pairs of left and right rpm")
    pairs = [(number(left, "left_rpm"), number(right, "right_rpm")) for left, right in commands]
    nominal = asked.body.get("nominal") or {}
    changes = {str(key): number(value, str(key)) for key, value in nominal.items()}
    effects = _effects(asked.body.get("effects") or {})
    duration = number(asked.body.get("duration_s", 8.0), "duration_s")
    drawn = sandbox_motions(robot, pairs, nominal=changes, effects=effects, duration_s=duration)
    found: Json = {"changed": drawn, "body": body_mm(robot)}
    if asked.body.get("base"):
        found["base"] = sandbox_motions(robot, pairs, nominal={}, effects={}, duration_s=duration)
    return found


def _robot(studio: Studio, said: Any) -> tuple[Path | str, Path | None]:
    """The robot of a request, and the experiment that names it."""
    identifier = said.get("experiment")
    if not identifier:
        return str(said.get("robot") or "barrel"), None
    path = studio.folder.path(str(identifier))
    robot = read_unfinished(path).robot
    return (studio.folder.inside(Path(robot)) if robot.endswith(".toml") else robot), path


def _commands(path: Path | None) -> list[list[float]]:
    """The commands of an experiment, each once."""
    rows = () if path is None else read_experiment(path).rows
    commands = [(run["left_rpm"], run["right_rpm"]) for run in rows if {"left_rpm", "right_rpm"} <= run.keys()]
    return [list(pair) for pair in dict.fromkeys(commands)]


def _effects(said: Any) -> dict[str, dict[str, Any]]:
    """Effects of a request: parameters by id."""
    if not isinstance(said, dict) or len(said) > MOST_EFFECTS or not all(isinstance(v, dict) for v in said.values()):
        raise InputError("effects: parameters by id")
    return {
        str(id_): {
            str(name): value if isinstance(value, str | list) else number(value, str(name))
            for name, value in values.items()
        }
        for id_, values in said.items()
    }


def _shown(studio: Studio, path: Path) -> str:
    try:
        return studio.folder.relative(path)
    except InputError:
        return path.name
