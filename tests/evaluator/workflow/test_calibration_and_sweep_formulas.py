"""Images that a calibration reads and leaves out, and parts of a sweep that are kept, lost or made again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.errors import CalibrationError
from evaluator.errors import InputError
from evaluator.workflow import calibration, sweep

GAUGE = object.__new__(calibration.Gauge)


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """How the solver was called; images named bad cannot be read."""
    calls: list[Any] = []

    def read(path: Path) -> np.ndarray:
        if path.name.startswith("bad"):
            raise CalibrationError(f"{path}: not an image")
        return np.zeros((2, 2))

    def solve(images: Any, _: Any, plate: int, **more: Any) -> Any:
        calls.append((len(images), plate, more))
        return SimpleNamespace(views=images, rms_px=0.01234)

    monkeypatch.setattr(calibration, "read_image", read)
    monkeypatch.setattr(calibration, "solve", solve)
    monkeypatch.setattr(calibration, "assess", lambda _, height: SimpleNamespace(summary=f"at {height:g} mm"))
    monkeypatch.setattr(calibration, "advise", lambda _, height: f"advice at {height:g} mm")
    return calls


def test_an_image_that_cannot_be_read_is_left_out_with_its_reason(solved: list[Any]) -> None:
    told: list[Any] = []
    images = ["bad.png", "plate.png", np.ones((2, 2)), "bad too.png"]
    found = calibration.calibrate(images, GAUGE, plate=1, mark_height_mm=2.0, progress=lambda *said: told.append(said))
    ((count, plate, more),) = solved
    assert (count, plate, more["names"]) == (2, 0, ["plate.png", "image 3"])
    assert more["left_out"] == [("bad.png", "not an image"), ("bad too.png", "not an image")]
    assert more["distance_mm"] is None
    assert repr(found) == "Calibrated(2 images, residual 0.012 px RMS; at 2 mm)"
    assert found.advice == "advice at 2 mm"  # type: ignore[comparison-overlap]
    assert [stage for stage, _ in told] == ["reading images", "calibrating", "assessing"]
    assert 0.0 == told[0][1] < told[1][1] < told[2][1] < 1.0


@pytest.mark.parametrize(
    ("images", "plate", "strict"),
    [(["bad.png", "a.png"], 0, False), (["a.png", "bad.png"], 0, True), (["bad.png"], 0, False)],
)
def test_the_image_of_the_plate_the_only_one_and_every_one_if_asked_for_have_to_be_read(
    images: list[str], plate: int, strict: bool, solved: list[Any]
) -> None:
    with pytest.raises(CalibrationError, match=r"bad\.png: not an image"):
        calibration.calibrate(images, GAUGE, plate=plate, strict=strict)
    assert solved == []


@pytest.mark.parametrize(("distance", "right"), [((100.0, 1.0), True), ((0.0, 1.0), False), ((100.0, 0.0), False)])
def test_a_distance_and_its_sigma_are_above_nought(
    distance: tuple[float, float], right: bool, solved: list[Any]
) -> None:
    if right:
        calibration.calibrate(["a.png"], GAUGE, distance_mm=distance)
        assert solved[0][2]["distance_mm"] == distance
    else:
        with pytest.raises(InputError, match="both must be positive"):
            calibration.calibrate(["a.png"], GAUGE, distance_mm=distance)


class Runs(SimpleNamespace):
    """A sweep of some runs."""

    def count(self) -> int:
        return int(self.runs)

    def model_dump_json(self) -> str:
        return f"{self.runs}"


@pytest.fixture
def swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A sweep of 1001 runs in parts of 500; the runs of some parts are lost, those of others counted."""
    robot, described = SimpleNamespace(model_dump_json=lambda: "robot"), Runs(runs=1001, robot="barrel")
    state = SimpleNamespace(lost=set(), made=[], told=[], output=tmp_path / "sweep.csv")

    def run_part(_: Any, __: Any, start: int, stop: int) -> pd.DataFrame:
        state.made.append((start, stop))
        return pd.DataFrame({"run": range(start, stop), "radius_mm": 1 / 3})

    @contextmanager
    def answers(work: Any, parts: list[Any], **more: Any) -> Iterator[Any]:
        assert more["workers"] == 1
        yield ((k, None if part.start in state.lost else work(part)) for k, part in enumerate(parts))

    monkeypatch.setattr(sweep, "read_with", lambda _, path: described if path.name == "sweep.toml" else robot)
    monkeypatch.setattr(sweep, "run_part", run_part)
    monkeypatch.setattr(sweep, "answers_of", answers)

    def run() -> sweep.SweepDone:
        progress = lambda _, done, count: state.told.append((done, count))  # noqa: E731
        return sweep.run_sweep("sweep.toml", state.output, workers=1, progress=progress)

    state.run = run
    return state


def test_parts_that_were_made_stay_when_others_are_lost_and_all_are_one_table(swept: Any) -> None:
    swept.lost = {500}
    with pytest.raises(InputError, match=r"sweep\.toml: 1 of 3 parts were not simulated"):
        swept.run()
    assert swept.made == [(0, 500), (1000, 1001)]
    assert swept.told == [(0, 3), (1, 3), (2, 3)]
    (folder,) = swept.output.parent.glob("*.parts-*")
    assert sorted(path.name for path in folder.iterdir()) == ["000000000-000000500.csv", "000001000-000001001.csv"]
    (folder / "000000000-000000500.csv").write_text("run,radius_mm\n0,1\n", encoding="utf-8")  # after a power failure
    swept.lost, swept.made[:], swept.told[:] = set(), [], []
    done = swept.run()
    assert swept.made == [(0, 500), (500, 1000)]
    assert (done.runs, done.parts, done.reused) == (1001, 3, 1)
    assert swept.told[0] == (1, 3)
    table = pd.read_csv(swept.output)
    assert table["run"].tolist() == list(range(1001))
    assert set(table["radius_mm"]) == {0.333333333}
    assert not folder.exists()
