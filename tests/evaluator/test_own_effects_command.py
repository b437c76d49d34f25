"""turnscope effects new, and effects of the user's own in the list."""

from __future__ import annotations

import json
from collections import ChainMap
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from evaluator.cli.experiment.diagnose import say_unused
from evaluator.cli.simulation.effects import effects
from evaluator.errors import InputError
from simulator.effects.catalogue import EFFECTS, OWN


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands run in an empty folder."""
    monkeypatch.chdir(tmp_path)


def said(*arguments: str) -> str:
    result = CliRunner().invoke(effects, arguments, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.output


def test_a_new_effect_is_written_listed_and_described_with_its_formula() -> None:
    assert said("new", "mixed-drive").strip() == str(Path("effects") / "mixed-drive.toml")
    assert "mixed-drive" in said()
    (described,) = [item for item in json.loads(said("--json")) if item["id"] == "mixed-drive"]
    assert described["law"].startswith("left_drive += right_to_left·right_command")
    assert "right_to_left" in said("mixed-drive")


def test_a_python_file_is_listed_only_where_it_is_named() -> None:
    said("new", "left-faster", "--python")
    with pytest.raises(InputError, match="no such effect"):
        said("left-faster")
    assert "v_left" in said("--effect", "left-faster.py", "left-faster")


def test_an_effect_of_an_installed_package_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = replace(EFFECTS["plate-tilt"], id="tilt-of-our-table")
    point = SimpleNamespace(name="ours", load=lambda: ours)
    monkeypatch.setattr("simulator.own_effects.files.entry_points", lambda **_: [point])
    try:
        assert "tilt-of-our-table" in said()
    finally:
        OWN.pop(ours.id, None)


def test_the_page_draws_an_own_effect_too(monkeypatch: pytest.MonkeyPatch) -> None:
    few = ChainMap(OWN, {"plate-tilt": EFFECTS["plate-tilt"]})  # another test draws the whole catalogue
    monkeypatch.setattr("evaluator.report.pages.effects.EFFECTS", few)
    said("new", "mixed-drive")
    said("--html", "page.html")
    page = Path("page.html").read_text(encoding="utf-8")
    assert "mixed-drive: what is wrong" in page
    assert 'id="plate-tilt"' in page


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("new",), "expected an id"),
        (("new", "Not An Id"), "lower-case letters, digits"),
        (("new", "plate-tilt"), "is an effect of the catalogue"),
        (("plate-tilt", "plate-tilt"), "a second ID, -o FILE and --python belong"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(arguments: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        said(*arguments)


def test_a_file_that_is_there_is_not_overwritten() -> None:
    said("new", "mixed-drive")
    with pytest.raises(InputError, match="exists already"):
        said("new", "mixed-drive")


def test_a_diagnosis_names_the_python_effects_beside_it_that_it_did_not_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "effects"
    folder.mkdir()
    for name in ("tested.py", "forgotten.py", "other.toml"):
        (folder / name).touch()
    say_unused(tmp_path / "experiment.toml", {"tested": str(folder / "tested.py"), "installed": "installed"})
    assert capsys.readouterr().err == (
        f"note: {folder / 'forgotten.py'} was not tested: a Python file is executed only if you name it "
        f"(--effect {folder / 'forgotten.py'})\n"
    )
