"""Effects of the user's own as the screen Diagnosis writes them."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from evaluator.workflow import out_folder
from simulator.own_effects.files import forget_own, load_own
from simulator.own_effects.template import TermRow, template
from simulator.robot import load_robot, shipped_robot_text
from tests.evaluator.studio.serving import Serving, serving

TERM = {"channel": "left_drive", "depends_on": "right_command", "pattern": "common", "coefficient": "mix", "unit": ""}
EXPERIMENT = """format = 1
name = "monday"
robot = "barrel"

[[run]]
id = "r01"
left_rpm = 33.3
right_rpm = 14.4
marks = "r01.csv"
"""
EFFECT: dict[str, Any] = {
    "version": "", "id": "mixed-drive", "name": "the drive mixes the sides", "sentence": "",
    "terms": [{**TERM, "low": -1.5, "high": "1.5", "step": 0.002}],
}  # fmt: skip


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    (tmp_path / "experiment.toml").write_text(EXPERIMENT)
    return tmp_path / "experiment.toml"


@pytest.fixture
def folder(experiment: Path) -> Path:
    return experiment.parent


def path_of(studio: Serving) -> str:
    return f"/api/experiments/{studio.get('/api/home')['experiments'][0]['id']}/own-effects"


def changed(**values: Any) -> dict[str, Any]:
    return {**EFFECT, **values}


def test_an_effect_of_terms_is_written_beside_the_experiment_and_read_by_every_command(
    studio: Serving, experiment: Path
) -> None:
    found = studio.post(path_of(studio), EFFECT)
    assert found["path"] == "effects/mixed-drive.toml"
    effect = load_own(experiment.parent / "effects" / "mixed-drive.toml")
    assert [(one.name, one.low, one.high, one.step) for one in effect.parameters] == [("mix", -1.5, 1.5, 0.002)]
    assert effect.law == "left_drive += mix·right_command"
    sandbox = "/api/sandbox?experiment=" + path_of(studio).split("/")[-2]
    assert "mixed-drive" in [one["id"] for one in studio.get(sandbox)["effects"]]
    assert "mixed-drive" not in [one["id"] for one in studio.get("/api/sandbox?robot=barrel")["effects"]]


def test_an_effect_is_changed_and_what_the_form_does_not_know_stays(studio: Serving, experiment: Path) -> None:
    file = experiment.parent / "effects" / "mixed-drive.toml"
    file.parent.mkdir()
    row = TermRow("left_drive", "right_command", "mix")
    text = template("mixed-drive", [row], "it mixes").replace('unit = ""', 'unit = ""\ntimes = 2.0  # both gears')
    file.write_text(text, encoding="utf-8")
    (there,) = studio.get(path_of(studio))["effects"]
    again = {**there["terms"][0], "channel": "right_drive", "depends_on": "left_command"}
    studio.post(path_of(studio), {**there, "terms": [{**there["terms"][0], "high": 0.5}, again]})
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    assert [term["channel"] for term in content["term"]] == ["left_drive", "right_drive"]
    assert (content["term"][0]["times"], content["term"][0]["high"]) == (2.0, 0.5)
    assert "# both gears" in file.read_text(encoding="utf-8")
    status, sentence = studio.refused(path_of(studio), {**there, "name": "another tab"})
    assert (status, "changed meanwhile" in sentence) == (409, True)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (changed(id="../robot"), "lower-case letters"),
        (changed(id="../../outside"), "outside the folder"),
        (changed(id="plate-tilt"), "effect of the catalogue"),
        (changed(terms=[]), "at least one"),
        (changed(terms=[{**EFFECT["terms"][0], "channel": "force"}]), "did you mean"),
        (changed(terms=[{**EFFECT["terms"][0], "depends_on": "heading"}]), "depends_on"),
        (changed(terms=[{**EFFECT["terms"][0], "step": "1e999"}]), "finite"),
        (changed(terms=[{**EFFECT["terms"][0], "low": 0.5}]), "must include 0"),
        (changed(terms=[{**TERM, "step": 0.1}]), "give the bounds"),
        (changed(name=None), "name is missing"),
    ],
)
def test_an_effect_that_cannot_be_is_refused_in_a_sentence(
    studio: Serving, experiment: Path, wrong: dict[str, Any], words: str
) -> None:
    before = sorted(experiment.parent.rglob("*"))
    status, sentence = studio.refused(path_of(studio), wrong)
    assert (status, words in sentence) == (400, True), sentence
    assert sorted(experiment.parent.rglob("*")) == before


def test_an_effect_that_is_written_or_taken_away_comes_back_by_undo(studio: Serving, experiment: Path) -> None:
    path, file = path_of(studio), experiment.parent / "effects" / "mixed-drive.toml"
    identifier = path.split("/")[-2]
    (written,) = studio.post(path, EFFECT)["effects"]
    assert studio.post(f"{path}/remove", {"id": "mixed-drive", "version": written["version"]})["effects"] == []
    assert not file.exists()
    assert studio.step("diagnosis", identifier) == "mixed-drive taken away"
    assert file.exists()
    studio.step("diagnosis", identifier)
    assert not file.exists()
    studio.step("diagnosis", identifier, "redo")
    assert file.exists()


def test_a_folder_that_leads_out_is_not_written_into(studio: Serving, experiment: Path, tmp_path_factory: Any) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (experiment.parent / "effects").symlink_to(outside)
    status, sentence = studio.refused(path_of(studio), EFFECT)
    assert (status, "outside the folder" in sentence) == (400, True)
    assert list(outside.iterdir()) == []


def test_the_form_of_an_unknown_verdict_is_offered_and_every_choice_makes_an_effect(
    studio: Serving, experiment: Path
) -> None:
    out = out_folder(experiment)
    out.mkdir()
    (out / "own_effect.toml").write_text(template("found-by-diagnosis"), encoding="utf-8")
    assert studio.get(path_of(studio))["offered"] is None
    (out / "diagnosis.json").write_text(json.dumps({"format": 1, "verdict": "unknown"}), encoding="utf-8")
    found = studio.get(path_of(studio))
    assert [term["channel"] for term in found["offered"]["terms"]] == ["left_drive", "right_drive"]
    terms = []
    for channel in found["grammar"]["channels"]:
        for basis in channel["bases"]:
            usual = {key: basis[key] for key in ("unit", "low", "high", "step")}
            place = {"channel": channel["id"], "depends_on": basis["id"], "pattern": "common"}
            terms.append({**place, **usual, "coefficient": f"{channel['id']}_by_{basis['id']}"})
    for first in range(0, len(terms), 40):
        studio.post(path_of(studio), changed(id=f"all-{first}", terms=terms[first : first + 40]))
    assert all(one["fault"] == "" for one in studio.get(path_of(studio))["effects"])


def test_an_effect_goes_with_the_robot_that_lies_in_another_folder_and_is_undone_with_it(tmp_path: Path) -> None:
    """Commands that know the robot alone find the effect beside it."""
    (tmp_path / "monday").mkdir()
    (tmp_path / "monday" / "experiment.toml").write_text(EXPERIMENT.replace('"barrel"', '"../shared/robot.toml"'))
    robot = tmp_path / "shared" / "robot.toml"
    robot.parent.mkdir()
    robot.write_text(shipped_robot_text("barrel"))
    with serving(tmp_path) as studio:
        studio.post(path_of(studio), EFFECT)
        identifier = path_of(studio).split("/")[3]
        experiment, undo = f"/api/experiments/{identifier}", f"/api/undo/sandbox/{identifier}"
        version = studio.get(f"{experiment}/diagnosis")["robot"]["version"]
        studio.get(f"/api/sandbox?experiment={identifier}")
        studio.post(f"{experiment}/robot", {"version": version, "effects": {"mixed-drive": {"mix": 0.02}}})
        forget_own()
        assert [entry.id for entry in load_robot(robot).effect] == ["mixed-drive"]
        step = studio.get(undo)["undo"]
        studio.post(undo, {"way": "undo", "number": step["number"]})
    assert robot.read_text() == shipped_robot_text("barrel")
    assert not (robot.parent / "effects" / "mixed-drive.toml").exists()
