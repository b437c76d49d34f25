"""Physics of the user's own: unknown without it, with a file that says what it is; named once the file lies there."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.output.own_effect import own_effects
from evaluator.workflow import diagnose
from simulator.own_effects.files import load_own
from simulator.own_effects.template import template
from simulator.robot import load_robot
from tests.evaluator.diagnosis.hidden import COMMANDS, offer_few, write_hidden

MIX = {"right_to_left": 0.3, "left_to_right": 0.2}


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a robot each side of whose drive gets a share of the other side's command."""
    folder = tmp_path_factory.mktemp("mixed")
    own = folder / "kept" / "mixed-drive.toml"
    own.parent.mkdir()
    own.write_text(template("mixed-drive", name="the drive mixes the sides"), encoding="utf-8")
    load_own(own)
    commands = (*COMMANDS[-4:], (50.0, 20.0), (-20.0, -50.0))
    return write_hidden(folder / "session", {"mixed-drive": MIX}, commands=commands, seconds=4.0, exact=True)


def test_every_free_form_term_is_an_effect_of_its_own_and_the_one_that_explains_most_comes_first(
    tmp_path: Path,
) -> None:
    mixing, fading = "free:left_drive.right_command+right_drive.left_command", "free:friction.abs_u"
    chosen, every = frozenset({mixing, fading, "speed-limit"}), free_terms()
    evidence = {chosen - {mixing}: 100.0, chosen - {fading}: 300.0}
    diagnosed: Any = SimpleNamespace(
        chosen=chosen,
        terms={mixing: every[mixing], fading: every[fading], "speed-limit": None},
        follows=True,
        fit=SimpleNamespace(point=SimpleNamespace(terms={mixing: (0.3, 0.2), fading: (-0.1,)})),
        search=SimpleNamespace(evidence=evidence.__getitem__),
    )
    ids = []
    for number, text in enumerate(own_effects(diagnosed)):
        file = tmp_path / f"{number}.toml"
        file.write_text(text, encoding="utf-8")
        ids.append((load_own(file).id, text.count("[[term]]\n")))
    assert ids == [("found-by-diagnosis", 2), ("found-by-diagnosis-2", 1)]
    diagnosed.follows = False
    assert own_effects(diagnosed) == []


def found(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    return content


def test_a_drive_that_mixes_its_sides_is_unknown_and_then_named_by_the_file_that_the_diagnosis_wrote(
    mixed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer_few(monkeypatch, ("command-lag", "drive-speed-mismatch", "drive-speed-scale"), ("left_drive", "right_drive"))
    diagnose(mixed, tmp_path / "before")
    before = found(tmp_path / "before")
    assert before["verdict"] == "unknown"
    text = (tmp_path / "before" / "own_effect.toml").read_text(encoding="utf-8")
    assert 'channel = "left_drive"\ndepends_on = "right_command"' in text
    assert 'channel = "right_drive"\ndepends_on = "left_command"' in text
    (mixed.parent / "effects").mkdir()
    (mixed.parent / "effects" / "sides.toml").write_text(text.replace("found-by-diagnosis", "sides"), encoding="utf-8")
    diagnose(mixed, tmp_path / "after")
    after = found(tmp_path / "after")
    assert after["verdict"] == "effect"
    assert [effect["id"] for effect in after["effects"]] == ["sides"]
    sizes = after["effects"][0]["parameters"]
    for name, value in (
        ("left_drive_by_right_command", MIX["right_to_left"]),
        ("right_drive_by_left_command", MIX["left_to_right"]),
    ):
        assert sizes[name]["low"] < value < sizes[name]["high"]
    better = load_robot(tmp_path / "after" / "robot_with_effect.toml")
    assert [entry.id for entry in better.effect] == ["sides"]
    gap = after["gap"]["predicted"]
    assert gap["after"]["held_out"] < 0.2 * gap["before"]["held_out"]
