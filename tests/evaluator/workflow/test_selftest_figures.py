"""Figures of the self-test in closed form, from files and answers that are known; nothing is rendered or searched."""

from __future__ import annotations

from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.workflow.samples import sample_folder
from evaluator.workflow.selftest import laboratory, run
from simulator.command import Command
from simulator.robot import load_robot

CLIP = "turn-33.3-14.4"


def truth(folder: Path, table: pd.DataFrame) -> None:
    table.to_csv(folder / f"{CLIP}-truth.csv", index=False)


def test_marks_are_judged_by_their_distance_from_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One mark is 3 and 4 µm off, the other 12 and 5 µm: 5 and 13 µm, root mean square √97 µm."""
    places = [f"{name}_{axis}_mm" for name in ("green", "yellow") for axis in "xy"]
    there = pd.DataFrame(np.arange(40.0).reshape(10, 4), columns=places)
    truth(tmp_path, there)
    seen = there + np.array([0.003, -0.004, -0.012, 0.005])
    seen.loc[[2, 5], "green_x_mm"] = nan
    asked: list[Any] = []

    def tracked(*given: Any, **named: Any) -> Any:
        asked.append((*given, named))
        return SimpleNamespace(marks=pd.concat([seen, seen.iloc[:1]]))  # a frame that the truth does not have

    monkeypatch.setattr(run, "track_recording", tracked)
    found = run._track(tmp_path, 1)
    assert found["frames"] == 0.8
    assert found["marks_um"] == pytest.approx(np.sqrt((8 * 25 + 10 * 169) / 18), rel=1e-6)
    assert asked == [(tmp_path / f"{CLIP}.mp4", tmp_path / "turn.csv", {"camera": tmp_path / "camera.json"})]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_radius_is_judged_by_the_arc_that_was_driven_once_the_motors_had_settled(
    way: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arc of 8 mm from 1.5 s on, on which the heading passes ±180°; before, the robot stood elsewhere."""
    time = np.arange(0.0, 6.0, 1 / 60)
    angle = way * (time + 2.0)
    arc = {"time_s": time, "x_mm": 8 * np.sin(angle), "y_mm": -8 * np.cos(angle)}
    table = pd.DataFrame({**arc, "heading_deg": np.degrees(np.angle(np.exp(1j * angle)))})
    table.loc[time <= 1.5, ["x_mm", "y_mm", "heading_deg"]] = [50.0, 50.0, 0.0]
    truth(tmp_path, table)
    row = {"radius_mm": 8.08, "radius_low_mm": 8.03, "radius_high_mm": 8.13}
    monkeypatch.setattr(run, "analyze", lambda *_: SimpleNamespace(turning=pd.DataFrame([row])))
    found = run._fit(tmp_path, 1)
    assert found["radius_percent"] == pytest.approx(1.0, rel=1e-2)  # chords of 1/60 rad are 1e-5 shorter than the arc
    assert found["radius_intervals"] == pytest.approx(1.6, rel=1e-2)
    text = (tmp_path / "turn.toml").read_text()
    assert 'left_rpm = 33.3\nright_rpm = 14.4\nstart_s = 0.5\nmarks = "turn.csv"' in text
    monkeypatch.setattr(run, "analyze", lambda *_: SimpleNamespace(turning=pd.DataFrame()))
    with pytest.raises(InputError, match="no turn could be fitted"):
        run._fit(tmp_path, 1)


def test_a_simulation_is_judged_by_its_farthest_point_from_the_shipped_path(monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = pd.read_csv(sample_folder() / "truth" / "turn-33-5.csv")
    asked: list[Any] = []

    def simulated(robot: Any, command: Command, times: Any, start: Any) -> Any:
        asked.append((robot.name, command.at(0.6), command.at(0.4), start.x_mm, start.y_mm, start.heading_rad))
        np.testing.assert_allclose(times, shipped["time_s"], atol=1e-6)
        off = np.linspace(0.0, 1.0, len(times))
        return SimpleNamespace(x_mm=shipped["x_mm"] + 3e-5 * off, y_mm=shipped["y_mm"] - 4e-5 * off)

    monkeypatch.setattr("simulator.simulation.simulate", simulated)
    assert run._simulate(Path(), 1)["simulated_um"] == pytest.approx(0.05)
    assert asked == [(load_robot("barrel").name, (33.0, 5.0), (0.0, 0.0), -3.0, 2.0, pytest.approx(pi / 3))]
    first = shipped.iloc[0]
    assert (first["x_mm"], first["y_mm"], first["heading_deg"]) == pytest.approx((-3.0, 2.0, 60.0), abs=1e-4)


def test_a_diagnosis_is_judged_by_what_it_names_leaves_out_and_measures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = {"value": 1.15, "low": 1.05, "high": 1.25}
    hidden = {"id": laboratory.HIDDEN, "parameters": {laboratory.PARAMETER: size}}
    other = {"id": "plate-tilt", "parameters": {}}
    messy = laboratory.HiddenEffect(tmp_path / "hidden.toml", "h03")
    monkeypatch.setattr(laboratory, "write_hidden_effect", lambda *_: messy)

    def judged(effects: list[Any], *runs: str) -> dict[str, float]:
        content = {"effects": effects, "mistakes": [{"runs": [name]} for name in runs]}
        answer = SimpleNamespace(effects=tuple(item["id"] for item in effects), content=content)
        monkeypatch.setattr(run, "diagnose", lambda *_: answer)
        return run._diagnose(tmp_path, 1)

    assert judged([hidden], "h03") == {"named": 1.0, "swapped": 1.0, "size_intervals": pytest.approx(0.5)}
    assert judged([other, hidden], "h03", "h04") == {"named": 0.0, "swapped": 0.0, "size_intervals": pytest.approx(0.5)}
    assert judged([other]) == {"named": 0.0, "swapped": 0.0}


class Even:
    """Draws that are known: two standard deviations, the upper bound."""

    def normal(self, size: Any = None) -> Any:
        return 2.0 if size is None else np.full(size, 2.0)

    def uniform(self, low: float, high: float) -> float:
        assert low == -high
        return high


def test_marks_of_a_hidden_effect_have_its_size_usual_scatter_and_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def simulated(robot: Any, command: Command, times: Any, start: Any) -> Any:
        asked.append(({entry.id: dict(entry.given) for entry in robot.effect}, command.at(0.29), command.at(0.31)))
        asked.append((len(times), times[1], start.x_mm, start.y_mm, start.heading_rad))
        return times

    monkeypatch.setattr("simulator.simulation.simulate", simulated)
    monkeypatch.setattr(
        "simulator.observation.marks_of_run", lambda _, times: pd.DataFrame({"time_s": times, "green_x_mm": 1.0})
    )
    table = laboratory._marks(load_robot("barrel"), (30.0, 20.0), Even())  # type: ignore[arg-type]
    given = {"axle-compliance": {"deg_per_mN": 1.1}, "friction-level": {"factor": 1.02}}
    assert asked[0] == ({**given, "drive-speed-scale": {"factor": pytest.approx(1.006)}}, (0.0, 0.0), (30.0, 20.0))
    assert asked[1] == (150, pytest.approx(1 / 30), 6.0, 6.0, pytest.approx(pi))
    np.testing.assert_allclose(table["green_x_mm"], 1.008)
    np.testing.assert_allclose(table["time_s"], np.arange(150) / 30)


def test_scenes_of_a_self_test_have_noise_of_its_seed_and_lie_in_its_folder(tmp_path: Path) -> None:
    orders = [*laboratory.gauge_orders(tmp_path, 7), laboratory.turn_order(tmp_path, 7)]
    assert [order.scene.seed for order in orders] == [*range(7, 6 + len(orders)), 107]
    assert orders[-1].scene.duration_s == laboratory.TURN_S  # type: ignore[union-attr]
    assert {order.output.parent for order in orders} == {order.truth.parent for order in orders} == {tmp_path}
    assert orders[-1].truth.name == f"{CLIP}-truth.csv"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("processor\t: 0\nmodel name\t: Fast: 3\nmodel name\t: Slow\n", "Fast: 3"),
        ("vendor : x\n", "arm"),
        (None, "arm"),
    ],
)
def test_a_processor_is_named_as_the_system_does(text: str | None, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(_: Path, **__: Any) -> str:
        if text is None:
            raise OSError
        return text

    monkeypatch.setattr(Path, "read_text", read)
    monkeypatch.setattr(run.platform, "processor", lambda: "arm")
    assert run._processor() == name
    monkeypatch.setattr(run.platform, "processor", lambda: "")
    assert run._processor() == ("unknown" if name == "arm" else name)


def test_stages_are_told_by_their_number_and_their_figures_stand_with_their_claims(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for stage in ("_render", "_calibrate", "_track", "_fit", "_simulate", "_diagnose"):
        monkeypatch.setattr(run, stage, lambda *given: {"frames": 1.0, "residual_px": inf} if given[1] == 4 else {})
    told: list[Any] = []
    found = run.self_test(tmp_path / "new", seed=4, progress=lambda *said: told.append(said))
    names = ("render", "calibrate", "track", "fit", "simulate", "diagnose", "done")
    assert told == [(name, number, 6) for number, name in enumerate(names)]
    assert list(found.seconds) == list(names[:-1])
    assert min(found.seconds.values()) >= 0.0
    by_id = {item.claim.id: item for item in found.outcomes}
    assert (by_id["frames"].value, by_id["residual_px"].value, by_id["named"].reason) == (1.0, inf, "not measured")
    assert (by_id["frames"].holds, by_id["residual_px"].holds, found.holds, found.seed) == (True, False, False, 4)
