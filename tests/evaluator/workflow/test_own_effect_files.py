"""Files of effects of one's own as forms write, change and remove them, and what a form offers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.workflow.editing.documents import ChangedMeanwhileError
from evaluator.workflow.editing.own_effects import (
    OwnEffect,
    offered_effect,
    own_effects,
    remove_own_effect,
    term_grammar,
    write_own_effect,
)

TERM: dict[str, Any] = {
    "channel": "left_drive", "depends_on": "right_command", "pattern": "common", "coefficient": "mix",
    "unit": "", "low": -1.5, "high": 1.5, "step": 0.002,
}  # fmt: skip
MIXED = OwnEffect("", "mixed-drive", "the drive mixes the sides", "", (TERM,))


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    return tmp_path / "experiment.toml"


def test_a_new_effect_is_written_once_with_the_bounds_of_its_coefficients(experiment: Path) -> None:
    path = write_own_effect(experiment, MIXED)
    assert path == experiment.parent / "effects" / "mixed-drive.toml"
    (found,) = own_effects(experiment)
    assert (found.id, found.name, found.sentence) == ("mixed-drive", MIXED.name, MIXED.name)  # of its own, or its name
    assert [(term["channel"], term["coefficient"], term["low"], term["high"]) for term in found.terms] == [
        ("left_drive", "mix", -1.5, 1.5)
    ]
    with pytest.raises(InputError, match="there is an effect mixed-drive already"):
        write_own_effect(experiment, MIXED)
    for bound in ("low", "high"):
        with pytest.raises(InputError, match="give the bounds of each coefficient"):
            write_own_effect(experiment, replace(MIXED, id="other", terms=({**TERM, bound: None},)))
    with pytest.raises(InputError, match="friction-level is an effect of the catalogue"):
        write_own_effect(experiment, replace(MIXED, id="friction-level"))
    with pytest.raises(InputError, match="channel"):
        write_own_effect(experiment, replace(MIXED, id="other", terms=({**TERM, "channel": "nowhere"},)))
    assert len(own_effects(experiment)) == 1


def test_a_changed_effect_keeps_comments_and_what_its_form_does_not_show(experiment: Path) -> None:
    path = write_own_effect(experiment, replace(MIXED, sentence="so"))
    path.write_text("# by hand\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    (found,) = own_effects(experiment)
    second = {**TERM, "channel": "right_drive", "depends_on": "left_command"}
    write_own_effect(experiment, replace(found, name="two", terms=({**found.terms[0], "high": 2.5}, second)))
    assert path.read_text(encoding="utf-8").startswith("# by hand\n")
    (two,) = own_effects(experiment)
    assert (two.name, two.sentence) == ("two", "so")
    assert [(term["channel"], term["depends_on"], term["high"]) for term in two.terms] == [
        ("left_drive", "right_command", 2.5), ("right_drive", "left_command", 2.5),  # of the coefficient they share
    ]  # fmt: skip
    write_own_effect(experiment, replace(two, terms=two.terms[:1]))
    assert [term["channel"] for term in own_effects(experiment)[0].terms] == ["left_drive"]
    with pytest.raises(ChangedMeanwhileError):
        write_own_effect(experiment, two)


def test_the_effect_that_is_asked_for_is_removed_in_the_version_that_was_seen(experiment: Path) -> None:
    write_own_effect(experiment, replace(MIXED, id="another"))
    path = write_own_effect(experiment, MIXED)
    with pytest.raises(InputError, match="there is no effect third"):
        remove_own_effect(experiment, "third", "")
    with pytest.raises(ChangedMeanwhileError):
        remove_own_effect(experiment, "mixed-drive", "another version")
    remove_own_effect(experiment, "mixed-drive", own_effects(experiment)[1].version)
    assert not path.exists()
    assert [effect.id for effect in own_effects(experiment)] == ["another"]


def test_an_effect_is_offered_as_one_that_is_not_written_yet(experiment: Path) -> None:
    path = write_own_effect(experiment, MIXED)
    offered = offered_effect(path)
    assert offered == replace(own_effects(experiment)[0], version="")
    assert offered_effect(experiment) is None
    path.write_text("nonsense = 1\n", encoding="utf-8")
    (broken,) = own_effects(experiment)
    assert (broken.id, broken.terms) == ("mixed-drive", ())
    assert "mixed-drive.toml" in broken.fault


def test_a_form_offers_the_bases_that_fit_a_channel_with_bounds_to_three_digits() -> None:
    channels = {item["id"]: item for item in term_grammar()["channels"]}
    of_wheels = {name for name, item in channels.items() if item["of_wheels"]}
    assert of_wheels == {"speed", "steer", "load", "stiffness", "drag", "friction", "friction_across"}
    assert len(channels["camera_x"]["bases"]) < len(channels["moment"]["bases"])  # no camera sees a load
    for item in channels.values():
        assert item["bases"]
        for basis in item["bases"]:
            assert basis["low"] < basis["high"]
            assert basis["step"] > 0
            assert all(float(f"{basis[key]:.3g}") == basis[key] for key in ("low", "high", "step"))
