"""A magnet beside the plate, whose pull falls off with distance, is found where it lies and as strong as it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from evaluator.cli.experiment.diagnose import diagnose
from tests.evaluator.diagnosis.hidden import offer_few, write_hidden

RIVALS = ("stray-magnet", "plate-tilt", "tether-spring", "tether-pull", "friction-gradient")  # all that pull by place


@pytest.mark.parametrize(
    ("hidden", "seed"),
    [
        pytest.param({"force_mN": 0.5, "x_mm": 8.0, "y_mm": 6.0}, 10, marks=pytest.mark.exam),  # among the paths
        ({"force_mN": 0.4, "x_mm": -10.0, "y_mm": 9.0, "exponent": 3.0}, 20),  # beside them; a pole and a dipole
    ],
)
def test_a_hidden_magnet_is_named_with_force_place_and_fall_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hidden: dict[str, float], seed: int
) -> None:
    offer_few(monkeypatch, RIVALS, ("force_plate", "friction"))
    experiment = write_hidden(tmp_path, {"stray-magnet": hidden}, seed=seed, exact=True)
    CliRunner().invoke(diagnose, [str(experiment), "-o", str(tmp_path / "out"), "-q"], standalone_mode=False)
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [effect["id"] for effect in content["effects"]] == ["stray-magnet"]
    found = content["effects"][0]["parameters"]
    for name, value in {"exponent": 2.0, **hidden}.items():
        assert found[name]["low"] < value < found[name]["high"], name
