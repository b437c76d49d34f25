"""Changes that a front end makes to an experiment.toml, and the sliders that it offers of a robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.errors import InputError
from evaluator.workflow.editing.documents import ChangedMeanwhileError
from evaluator.workflow.editing.experiments import Edit, edit_experiment, read_experiment
from evaluator.workflow.viewing.results import results_view
from evaluator.workflow.viewing.sandbox import NOMINAL, SLIDER_STEPS, robot_sliders

HEAD = 'format = 1\nname = "two"\nrobot = "barrel"\n'


def run(name: str) -> str:
    return f'\n[[run]]\nid = "{name}"\nleft_rpm = 30.0\nright_rpm = 20.0\nmarks = "{name}.csv"\n'


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    path = tmp_path / "experiment.toml"
    path.write_text(HEAD + run("a") + run("b"), encoding="utf-8")
    return path


def ids(path: Path) -> list[str]:
    return [row["id"] for row in read_experiment(path).rows]


LAST = ["a", "b", "new"]


@pytest.mark.parametrize(("row", "order"), [(None, LAST), (0, ["a", "new", "b"]), (1, LAST), (9, LAST)])
def test_a_run_is_added_after_the_row_that_is_named_and_at_the_end_without_one(
    row: int | None, order: list[str], experiment: Path
) -> None:
    version = read_experiment(experiment).version
    edit_experiment(experiment, version, [Edit("add", row, values={"id": "new", "left_rpm": 5.0})])
    assert ids(experiment) == order


NOWHERE = [Edit("remove"), Edit("remove", -1), Edit("remove", 2), Edit("set", -1, "id", "x"), Edit("set", 2, "id", "x")]


@pytest.mark.parametrize("edit", NOWHERE, ids=lambda edit: f"{edit.kind} {edit.row}")
def test_a_row_that_is_not_there_is_neither_changed_nor_removed(edit: Edit, experiment: Path) -> None:
    before = experiment.read_bytes()
    with pytest.raises(InputError, match="this run is no longer in the file"):
        edit_experiment(experiment, read_experiment(experiment).version, [edit])
    assert experiment.read_bytes() == before


def test_the_run_that_is_named_goes_and_the_last_takes_its_table_along(experiment: Path) -> None:
    edit_experiment(experiment, read_experiment(experiment).version, [Edit("remove", 0)])
    assert ids(experiment) == ["b"]
    edit_experiment(experiment, read_experiment(experiment).version, [Edit("remove", 0)])
    assert experiment.read_text(encoding="utf-8").strip() == HEAD.strip()


def test_a_file_that_another_program_changed_is_not_written_over(experiment: Path) -> None:
    version = read_experiment(experiment).version
    experiment.write_text(HEAD + run("theirs"), encoding="utf-8")
    with pytest.raises(ChangedMeanwhileError):
        edit_experiment(experiment, version, [Edit("set", 0, "id", "mine")])
    assert ids(experiment) == ["theirs"]


def test_an_experiment_without_results_has_no_runs_to_show(experiment: Path) -> None:
    assert results_view(experiment).runs == ()


def test_sliders_reach_from_half_of_nominal_to_twice_of_it_in_even_steps() -> None:
    found = {slider.key: slider for slider in robot_sliders("barrel")}
    assert found.keys() == {key for key, *_ in NOMINAL}
    mass = found["body.mass_g"]
    assert (mass.low, mass.value, mass.high) == pytest.approx((0.25, 0.5, 1.0))
    for slider in found.values():
        assert slider.low + SLIDER_STEPS * slider.step == pytest.approx(slider.high)
