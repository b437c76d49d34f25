"""Effects of the user: known to worker processes, part of what results depend on, and never executed unasked."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from evaluator.settings import load_experiment
from evaluator.workflow.execution import answers
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.job import jobs_of
from evaluator.workflow.runs.stored_diagnosis import earlier_diagnosis
from simulator.effects.catalogue import EFFECTS
from simulator.own_effects.files import forget_own, load_own
from simulator.own_effects.template import TermRow, template
from simulator.robot import shipped_robot_text
from tests.evaluator.synthetic import circling_marks, write_experiment


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """One run of a robot with an effect of the user's own."""
    path = write_experiment(tmp_path, [("r01", 14.4, 33.3, circling_marks(6.0))])
    path.write_text(path.read_text(encoding="utf-8").replace('"barrel"', '"robot.toml"'), encoding="utf-8")
    robot = f'{shipped_robot_text("barrel")}\n[[effect]]\nid = "pull"\nforce = 0.1\n'
    (tmp_path / "robot.toml").write_text(robot, encoding="utf-8")
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "pull.toml").write_text(template("pull", [TermRow("force_left", "one", "force")]), "utf-8")
    return path


def is_known(effect: str) -> bool:
    return effect in EFFECTS


def in_a_process_that_knows_none(
    work: Callable[[str], bool], jobs: Sequence[str], **_: object
) -> Iterator[tuple[int, bool]]:
    forget_own()
    yield from enumerate(map(work, jobs))


def test_worker_processes_know_the_effects_of_the_process_that_they_work_for(
    experiment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_own(experiment.parent / "effects" / "pull.toml")
    monkeypatch.setattr(answers, "in_processes", in_a_process_that_knows_none)
    with answers.answers_of(is_known, ["pull", "push"], when_killed=lambda _: False) as found:
        assert dict(found) == {0: True, 1: False}


def test_a_simulation_is_out_of_date_once_the_file_of_its_effect_changes(experiment: Path) -> None:
    def keys() -> dict[str, str]:
        (job,) = jobs_of(load_experiment(experiment), Outputs(experiment.parent / "out"), simulate=True)
        return job.keys()

    before, file = keys(), experiment.parent / "effects" / "pull.toml"
    file.write_text(file.read_text(encoding="utf-8").replace("force_left", "force_forward"), encoding="utf-8")
    after = keys()
    assert {stage for stage in before if before[stage] != after[stage]} == {"simulate"}


def test_a_stored_diagnosis_does_not_execute_the_python_file_that_it_names(experiment: Path, tmp_path: Path) -> None:
    file, outputs = tmp_path / "own.py", Outputs(tmp_path / "out")
    file.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')", encoding="utf-8")
    outputs.diagnosis.parent.mkdir()
    outputs.diagnosis.write_text(json.dumps({"verdict": "none", "own_effects": {"own": str(file)}}), encoding="utf-8")
    assert earlier_diagnosis(load_experiment(experiment), outputs) is not None
    assert not (tmp_path / "ran").exists()
