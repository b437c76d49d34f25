"""turnscope effects: the catalogue in the terminal, for programs and as a page; and an effect that is one file."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.simulation.effects import effects
from evaluator.errors import InputError
from evaluator.report.pages.effects import DURATION_S, _measured, effects_page
from simulator.command import Command
from simulator.effects.catalogue import EFFECTS
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate

ROOT = Path(__file__).parents[2]


def said(*arguments: str) -> str:
    result = CliRunner().invoke(effects, arguments, standalone_mode=False)
    if result.exception:
        raise result.exception
    return result.output


def test_every_effect_is_listed_with_its_sentence() -> None:
    listed = " ".join(said().split())
    assert all(effect.id in listed for effect in EFFECTS.values())
    assert "The plate slopes by angle_deg" in listed


@pytest.mark.parametrize("effect_id", sorted(EFFECTS))
def test_every_effect_states_law_source_limits_and_parameters(effect_id: str) -> None:
    content = json.loads(said(effect_id, "--json"))
    assert [item["name"] for item in content["parameters"]] == [item.name for item in EFFECTS[effect_id].parameters]
    text = re.sub(r"\s+", "", said(effect_id))
    for key in ("sentence", "law", "source", "limits"):
        assert content[key]
        assert re.sub(r"\s+", "", content[key]) in text
    for item in content["parameters"]:
        assert item["name"] in text
        assert item["low"] is None or item["low"] <= item["absent"] <= item["high"]


@pytest.mark.parametrize(("effect_id", "told"), [("friction-across", True), ("scrub-torque", False)])
def test_an_effect_that_a_diagnosis_seeks_last_for_small_robots_says_so(effect_id: str, *, told: bool) -> None:
    assert EFFECTS[effect_id].of_ground == told
    text = said(effect_id)
    assert (
        "seeks it last for robots whose wheels are on average less than 45 mm from their middle"
        in " ".join(text.split())
    ) == told


def test_a_misspelt_effect_is_answered_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean plate-tilt"):
        said("plate-tlit")
    with pytest.raises(InputError, match="--html FILE"):
        said("plate-tilt", "--html", "x.html")


def test_the_page_draws_every_effect_where_it_shows() -> None:
    page = effects_page()
    for effect in EFFECTS.values():
        assert f'id="{effect.id}"' in page
    apart = [float(text) for text in re.findall(r"paths are (\S+)\smm apart", page)]
    assert len(apart) == len(EFFECTS)
    assert min(apart) > 0.05


def test_without_an_effect_the_drawn_path_is_that_of_the_robots_centre() -> None:
    barrel = load_robot("barrel")
    drawn = _measured(barrel, barrel)
    run = simulate(barrel, Command.constant(33.3, 14.4), drawn["time_s"].to_numpy(), State(0.0, 0.0, 0.0))
    assert drawn["time_s"].iloc[-1] == DURATION_S
    assert np.abs(drawn[["x_mm", "y_mm"]].to_numpy() - np.stack([run.x_mm, run.y_mm], axis=1)).max() < 1e-4


NEW_EFFECT = """
from simulator.dynamics.terms import FORCE_LEFT, SIGN_U, Term
from simulator.effects.definition import Effect
from simulator.effects.parameter import Parameter

EFFECT = Effect(
    id="side-wind",
    name="a wind from the side",
    sentence="A force to the left while driving forward, to the right while driving backward.",
    law="F = force_mN · sign(u)",
    source="none",
    limits="everywhere",
    kind="dynamics",
    parameters=(Parameter("force_mN", "mN", 0.0, 0.05, -5.0, 5.0),),
    act=lambda draft, values: draft.add(Term(FORCE_LEFT, SIGN_U, 1000 * values["force_mN"])),
)
"""
USE = """
import sys
import simulator.effects
simulator.effects.__path__.append(sys.argv[1])
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot, load_robot
robot = load_robot(sys.argv[2])
from simulator.steady import steady_turn
assert steady_turn(robot, 33.3, 14.4).radius_mm != steady_turn(load_robot("barrel"), 33.3, 14.4).radius_mm
from evaluator.diagnosis.candidates.coordinates import named_terms
candidate = named_terms(20.0, (30.0,))["side-wind"]
assert candidate.coordinates[0].step == 0.05 and candidate.physical((2.0,)) == {"force_mN": 2.0}
from evaluator.report.diagnosis.values import parameter
assert parameter("force_mN", "side-wind") == ("force", "mN")
from evaluator.report.pages import effects as page
page.EFFECTS = {"side-wind": page.EFFECTS["side-wind"]}  # another test draws the others
assert "a wind from the side" in page.effects_page()
from evaluator.cli import main
sys.argv = ["turnscope", "effects", "side-wind"]
main()
"""


def test_a_new_effect_is_one_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "side_wind.py").write_text(NEW_EFFECT, encoding="utf-8")
    barrel = (ROOT / "simulator" / "robots" / "barrel.toml").read_text(encoding="utf-8")
    robot = tmp_path / "robot.toml"
    robot.write_text(f'{barrel}\n[[effect]]\nid = "side-wind"\nforce_mN = 0.5\n', encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path / "effects"), str(robot)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "F = force_mN · sign(u)" in done.stdout
