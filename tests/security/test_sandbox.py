"""With --sandbox, no file leads out of its folder: neither by a path nor by a link."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evaluator.settings import load_experiment
from evaluator.workflow.checks import check_experiment
from simulator.files.named import SANDBOX
from simulator.own_effects.files import load_beside
from simulator.rendering.scene import load_scene
from simulator.robot import shipped_robot_text
from simulator.sweep import load_sweep
from tests.end_to_end.commands import turnscope
from tests.evaluator.synthetic import circling_marks, write_experiment

SCENE = 'rig = "../secret.toml"\nkind = "run"\n'
SWEEP = 'format = 1\nname = "s"\nduration_s = 1.0\nrobot = "../secret.toml"\n[grid]\n"body.mass_g" = [0.5]\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(SANDBOX, "")  # and forgotten after the test
    inside = tmp_path / "inside"
    (inside / "effects").mkdir(parents=True)
    (tmp_path / "secret.toml").write_text(shipped_robot_text("barrel"), encoding="utf-8")
    (inside / "link.toml").symlink_to(tmp_path / "secret.toml")
    return inside


@pytest.mark.parametrize("name", ["../secret.toml", "{}/secret.toml", "link.toml"])
def test_an_experiment_that_names_a_file_outside_is_refused_in_a_sentence(name: str, folder: Path) -> None:
    experiment = write_experiment(folder, [("r01", 14.4, 33.3, circling_marks(6.0, seconds=0.1))])
    name = name.format(folder.parent)
    text = experiment.read_text(encoding="utf-8").replace("[[run]]", f'[[run]]\nrobot = "{name}"', 1)
    experiment.write_text(text, encoding="utf-8")
    assert "sandbox" not in turnscope("check", experiment).stderr
    done = turnscope("--sandbox", folder, "check", experiment)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"error: {experiment}: cannot be read ({name} lies outside of the sandbox {folder})\n"


@pytest.mark.parametrize(("key", "name"), [("robot", "secret"), ("robot", "../secret"), ("marks", "../secret")])
def test_nothing_of_a_file_outside_is_told_whatever_its_name(
    key: str, name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first words of a file outside stood in the error: robots without .toml, and all that check reads itself."""
    (folder.parent / "secret").write_text("password = secret\n", encoding="utf-8")
    experiment = write_experiment(folder, [("r01", 14.4, 33.3, circling_marks(6.0, seconds=0.1))])
    lines = [line for line in experiment.read_text(encoding="utf-8").splitlines() if not line.startswith(key)]
    lines.insert(lines.index("[[run]]") + (key == "marks"), f'{key} = "{name}"')
    experiment.write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.chdir(folder.parent)  # where a robot named secret is beside no experiment
    monkeypatch.setenv(SANDBOX, str(folder))
    found = check_experiment(experiment).faults
    assert found
    assert not any("password" in fault or "TOML" in fault for fault in found)
    if "/" in name:
        assert found == (f"{experiment}: cannot be read ({name} lies outside of the sandbox {folder})",)


def test_files_inside_are_read_as_without_a_sandbox(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = write_experiment(folder, [("r01", 14.4, 33.3, circling_marks(6.0, seconds=0.1))])
    free = load_experiment(experiment)
    monkeypatch.setenv(SANDBOX, str(folder))
    assert load_experiment(experiment) == free


@pytest.mark.parametrize(("load", "text"), [(load_scene, SCENE), (load_sweep, SWEEP)])
def test_scenes_and_sweeps_do_not_leave_it_either(
    load: Callable[[Path], Any], text: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "file.toml").write_text(text, encoding="utf-8")
    monkeypatch.setenv(SANDBOX, str(folder))
    with pytest.raises(PermissionError, match="outside of the sandbox"):
        load(folder / "file.toml")


def test_an_own_effect_that_is_a_link_to_the_outside_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "effects" / "mine.toml").symlink_to(folder.parent / "secret.toml")
    monkeypatch.setenv(SANDBOX, str(folder))
    with pytest.raises(PermissionError, match="outside of the sandbox"):
        load_beside(folder)
