from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.robot_geometry import read_geometry, robot_shape
from simulator.robot import load_robot


@pytest.mark.parametrize("name", ["barrel", "two_driven_caster", "four_driven", "six_driven"])
def test_measurement_reads_the_shape_that_the_simulator_has(name: str) -> None:
    shape = read_geometry(Path(name)).shape
    assert shape is not None
    assert shape == robot_shape(load_robot(name))
