"""What runs determine of an effect besides its parameters."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from evaluator.diagnosis.output import effects_json


def test_what_runs_determine_besides_the_parameters_of_an_effect_is_told_with_its_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The ratio of the loads of driven and driving wheels, whose attractions are known to a factor only."""
    magnets = SimpleNamespace(id="magnets", absent=(1.0,), known=lambda values: {"load": 0.2 * values[0]})
    fit = SimpleNamespace(point=SimpleNamespace(terms={"magnets": (1.5,)}))
    monkeypatch.setattr(effects_json, "_drawn", lambda *_: {"load": np.linspace(0.1, 0.5, 401), "factor": None})
    found = effects_json._determined(SimpleNamespace(fit=fit), magnets)
    assert found == {"load": {"value": 0.3, "low": 0.11, "high": 0.49, "stated": 0.2}}
