from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.mistakes.recognised import Mistake
from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.workflow import Analysis, analyze, measure, pending
from evaluator.workflow.checks import check_experiment
from simulator.nominal_robot import WHEELS
from tests.evaluator.synthetic import circling_marks, three_runs, write_experiment


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Analysis]:
    folder = tmp_path_factory.mktemp("experiment")
    experiment = three_runs(folder)
    return experiment, analyze(experiment, folder / "out", simulate=True, workers=1)


def test_every_run_has_a_row_with_the_radius_of_its_circle(analysed: tuple[Path, Analysis]) -> None:
    table = pd.read_csv(analysed[1].outputs.turning).set_index("run")
    assert list(table.index) == ["r01", "r02", "r03"]
    assert table.loc["r01", "radius_mm"] == pytest.approx(6.0, rel=2e-3)
    assert table.loc["r02", "radius_mm"] == pytest.approx(3.5, rel=2e-3)
    assert np.isnan(table.loc["r03", "radius_mm"])
    assert "straight" in table.loc["r03", "radius_status"]


def test_results_do_not_depend_on_the_number_of_workers(analysed: tuple[Path, Analysis], tmp_path: Path) -> None:
    experiment, one = analysed
    many = analyze(experiment, tmp_path / "out", simulate=True, workers=2)
    assert contents(many.outputs.folder) == contents(one.outputs.folder)


def test_a_second_analysis_reuses_everything_and_changes_nothing(analysed: tuple[Path, Analysis]) -> None:
    experiment, first = analysed
    before = contents(first.outputs.folder)
    second = analyze(experiment, first.outputs.folder, simulate=True, workers=1)
    assert second.reused == 3
    assert contents(second.outputs.folder) == before


def test_runs_measured_first_have_the_same_radii_and_leave_only_the_simulation_to_do(
    analysed: tuple[Path, Analysis], tmp_path: Path
) -> None:
    experiment, whole = analysed
    first = measure(experiment, tmp_path / "out", workers=1)
    assert first.comparison is None
    assert first.reused == 0
    pd.testing.assert_frame_equal(first.turning, whole.turning)
    assert not first.outputs.turning.exists()
    assert set(map(tuple, pending(experiment, tmp_path / "out", simulate=True).values())) == {("simulate",)}
    after = analyze(experiment, tmp_path / "out", simulate=True, workers=1)
    assert contents(after.outputs.folder) == contents(whole.outputs.folder)


def test_a_run_with_a_mistake_is_measured_and_not_pooled(
    analysed: tuple[Path, Analysis], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, whole = analysed
    assert whole.pooled["left_rpm"].tolist() == whole.turning["left_rpm"].tolist()  # every command once
    shutil.copytree(whole.outputs.folder, tmp_path / "out")
    mistake = Mistake(("r02",), "reversed", "r02 drives backward")
    monkeypatch.setattr("evaluator.workflow.analysis.mistakes_of_marks", lambda *_: [mistake])
    found = analyze(experiment, tmp_path / "out", simulate=True, workers=1)
    assert found.turning["radius_mm"].notna().tolist() == [True, True, False]
    assert found.pooled["left_rpm"].tolist() == whole.turning["left_rpm"].tolist()[::2]
    assert len(pd.read_csv(found.outputs.pooled)) == 2


def test_wheels_of_every_run_have_their_slips_beside_the_simulated_ones(analysed: tuple[Path, Analysis]) -> None:
    _, found = analysed
    assert found.comparison is not None
    outer = found.turning["wall_to_wall_radius_mm"]
    assert (outer[:2] > found.turning["outer_wheel_radius_mm"][:2]).all()
    assert outer[0] == pytest.approx(np.hypot(2.5, 6.0 + 4.5), rel=0.01)  # the circle that the marks were put on
    for wheel in WHEELS:
        for name in (f"{wheel}_slip_angle_deg", *([f"{wheel}_slip_ratio"] if "front" in wheel else [])):
            assert found.turning[name].notna().all()
            assert found.comparison[f"simulated_{name}"].notna().all()
    # 2 mm/s on the outer circle of r01: the front right wheel is 8 mm from the centre of rotation, 6 mm ahead of it
    assert found.turning["front_right_slip_ratio"][0] == pytest.approx(1 - 33.3 * np.pi / 60 / (2 * 8 / 6), abs=2e-3)


def test_only_what_a_changed_file_touches_is_computed_again(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    out = tmp_path / "out"
    analyze(experiment, out, simulate=True, workers=1)
    circling_marks(7.0, seed=9).to_csv(tmp_path / "r01.csv", index=False)
    text = experiment.read_text(encoding="utf-8").replace("left_rpm = 5.0", "left_rpm = 6.0")
    experiment.write_text(text, encoding="utf-8")
    (out / "simulated" / "r03.csv").unlink()
    stages = pending(experiment, out, simulate=True)
    assert stages == {"r01": ["read marks", "turn", "simulate"], "r02": ["turn", "simulate"], "r03": ["simulate"]}


@pytest.mark.parametrize("workers", [1, 2])
def test_a_cancelled_analysis_resumes_and_ends_as_an_uninterrupted_one(
    analysed: tuple[Path, Analysis], tmp_path: Path, workers: int
) -> None:
    experiment, whole = analysed
    out = tmp_path / "out"

    def cancel_after_one(stage: str, done: float, total: float = 1.0, /) -> None:
        assert (stage, total) == ("runs", 3)
        if done >= 1:
            raise Cancelled

    with pytest.raises(Cancelled):
        analyze(experiment, out, simulate=True, workers=workers, progress=cancel_after_one)
    assert not (out / "turning.csv").exists()
    rest = analyze(experiment, out, simulate=True, workers=workers)
    assert rest.reused >= 1
    assert contents(out) == contents(whole.outputs.folder)


def test_a_bad_recording_does_not_stop_the_others(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    (tmp_path / "r02.csv").write_text("time_s,green_x_mm\n0,1\n", encoding="utf-8")
    found = analyze(experiment, tmp_path / "out", workers=1)
    assert list(found.faults) == ["r02"]
    assert "yellow_x_mm" in found.faults["r02"]
    assert found.turning["radius_mm"].notna().tolist() == [True, False, False]
    assert found.turning["radius_status"][1] == found.faults["r02"]
    assert not (tmp_path / "out" / "marks" / "r02.csv").exists()


def test_results_of_an_input_that_has_become_bad_do_not_stay(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    analyze(experiment, tmp_path / "out", workers=1)
    (tmp_path / "r02.csv").write_text("", encoding="utf-8")
    analyze(experiment, tmp_path / "out", workers=1)
    assert not (tmp_path / "out" / "poses" / "r02.csv").exists()


def test_an_experiment_without_one_good_run_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    experiment = write_experiment(tmp_path, [("r01", 1.0, 2.0, circling_marks(6.0))])
    (tmp_path / "r01.csv").unlink()
    with pytest.raises(InputError, match=r"r01\.csv"):
        analyze(experiment, tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()


def test_a_simulated_counterpart_starts_where_the_robot_did(analysed: tuple[Path, Analysis]) -> None:
    _, found = analysed
    for run in ("r01", "r02", "r03"):
        poses, simulated = pd.read_csv(found.outputs.poses(run)), pd.read_csv(found.outputs.simulated(run))
        assert np.hypot(simulated["x_mm"][0] - poses["x_mm"][0], simulated["y_mm"][0] - poses["y_mm"][0]) < 0.02
        assert simulated["heading_deg"][0] == pytest.approx(poses["heading_deg"][0], abs=0.5)


def test_a_comparison_of_earlier_results_does_not_stay_beside_new_ones(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    analyze(experiment, tmp_path / "out", simulate=True, workers=1)
    analyze(experiment, tmp_path / "out", workers=1)
    assert (tmp_path / "out" / "comparison.csv").exists()
    circling_marks(7.0, seed=9).to_csv(tmp_path / "r01.csv", index=False)
    analyze(experiment, tmp_path / "out", workers=1)
    assert not (tmp_path / "out" / "comparison.csv").exists()


def test_marks_too_far_apart_put_every_length_in_doubt(tmp_path: Path) -> None:
    marks = circling_marks(6.0, seconds=3)
    marks.iloc[:, 1:] *= 1.1  # a gauge of 2.0 mm taken for one of 2.2 mm
    found = analyze(write_experiment(tmp_path, [("r01", 14.4, 33.3, marks)]), tmp_path / "out", workers=1)
    assert any(note.startswith("the marks are 10 % farther apart") for note in found.notes["r01"])
    good = analyze(three_runs(tmp_path / "good"), tmp_path / "good" / "out", workers=1)
    assert not [note for notes in good.notes.values() for note in notes if "apart" in note]


def test_measuring_needs_no_more_of_robot_toml_than_marks(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    text = experiment.read_text(encoding="utf-8").replace('robot = "barrel"', 'robot = "robot.toml"')
    experiment.write_text(text, encoding="utf-8")
    (tmp_path / "robot.toml").write_text(
        "[marks]\ngreen_mm = [-1.55, 1.83]\nyellow_mm = [-1.55, -1.83]\n", encoding="utf-8"
    )
    assert check_experiment(experiment).faults == ()
    found = analyze(experiment, tmp_path / "out", workers=1)
    assert not found.faults
    assert found.turning["radius_mm"][0] == pytest.approx(6.0, rel=1e-3)
    with pytest.raises(InputError, match="slip is missing"):
        analyze(experiment, tmp_path / "out", workers=1, simulate=True)


def test_a_check_reads_the_experiment_as_often_for_many_runs_as_for_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = circling_marks(6.0, seconds=0.1)
    read, calls = tomllib.loads, []
    monkeypatch.setattr(tomllib, "loads", lambda text: calls.append(text) or read(text))

    def times_read(runs: int) -> int:
        folder = tmp_path / str(runs)
        experiment = write_experiment(folder, [(f"r{k}", 14.4, 33.3, marks * (1 + k)) for k in range(runs)])
        check_experiment(experiment)
        return calls.count(experiment.read_text(encoding="utf-8"))

    assert times_read(1) == times_read(4) > 0
