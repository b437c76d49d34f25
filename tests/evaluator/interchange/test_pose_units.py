"""Headings in another unit than their column says, by the direction of the path."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.interchange.pose_units import heading_unit


def table(turn_rad_s: float = 0.4, times: float = 1.0, slip_rad: float = 0.0, way: float = 1.0) -> pd.DataFrame:
    """A drive that weaves; times: factor of the stated headings."""
    rng = np.random.default_rng(1)
    time = np.arange(0, 40, 0.05)
    heading = 1.0 + np.cumsum(turn_rad_s * (1 + np.sin(time / 3))) * 0.05
    path = np.cumsum(way * 200 * np.exp(1j * (heading + slip_rad * np.sin(time)))) * 0.05
    noise = rng.normal(size=(len(time), 2))
    wrapped = np.degrees(np.angle(np.exp(1j * heading)))
    return pd.DataFrame(
        {"time_s": time, "x_mm": path.real + noise[:, 0], "y_mm": path.imag + noise[:, 1]}
        | {"heading_deg": times * wrapped, "x_sigma_mm": 1.0, "y_sigma_mm": 1.0}
    )


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("slip_rad", [0.0, 0.3])
@pytest.mark.parametrize(
    ("times", "said"), [(1.0, ""), (180 / np.pi, "degrees, not radians"), (np.pi / 180, "radians, not degrees")]
)
def test_unit_of_headings_shows_in_a_path_that_bends(times: float, said: str, slip_rad: float, way: float) -> None:
    assert heading_unit(table(times=times, slip_rad=slip_rad, way=way)) == said


def test_on_a_straight_path_and_at_rest_no_unit_shows() -> None:
    assert heading_unit(table(turn_rad_s=0.0, times=180 / np.pi)) == ""
    still = table()
    still[["x_mm", "y_mm"]] = 5.0
    assert heading_unit(still) == ""
    assert heading_unit(still.iloc[:0]) == ""


def test_a_robot_that_spins_while_it_is_dragged_along_shows_none_either() -> None:
    dragged = table()
    dragged["x_mm"], dragged["y_mm"] = 200 * dragged["time_s"], 0.0
    assert heading_unit(dragged) == ""
