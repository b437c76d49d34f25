from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.turning.repetitions import compare_directions, disagreement, pool_runs

LEFT = {"yaw_rate_deg_s": 20.0, "speed_mm_s": 2.0}
RIGHT = {"yaw_rate_deg_s": -20.0, "speed_mm_s": 2.0}


def runs_of(left: float, right: float, radii: list[float], motion: dict[str, float], **more: object) -> pd.DataFrame:
    sign = -1.0 if motion["yaw_rate_deg_s"] * motion["speed_mm_s"] < 0 else 1.0
    curvature = np.nan_to_num(sign / np.array(radii))
    return pd.DataFrame(
        {
            "left_rpm": left,
            "right_rpm": right,
            "radius_mm": radii,
            "radius_random_mm": 0.01,
            "radius_systematic_mm": 0.02,
            "curvature_per_mm": curvature,
            "curvature_low_per_mm": curvature - 1e-4,
            "curvature_high_per_mm": curvature + 1e-4,
            "speed_random_mm_s": 0.001,
            "path_efficiency": 1.0,
            "smoothness": -2.0,
            **motion,
            **more,
        }
    )


def test_commands_are_pooled_one_by_one_and_what_the_standard_asks_for_is_said() -> None:
    table = pd.concat(
        [
            runs_of(33.0, 14.0, [7.8, 7.9, 7.85], RIGHT),
            runs_of(14.0, 33.0, [7.9, 7.8], LEFT),
            runs_of(-33.0, -14.0, [7.8] * 3, {"yaw_rate_deg_s": 20.0, "speed_mm_s": -2.0}),
            runs_of(33.0, 33.0, [np.nan], RIGHT),
        ]
    )
    pools = pool_runs(table).set_index(["left_rpm", "right_rpm"])
    assert pools["side"].tolist() == ["right", "left", "right", ""]
    assert pools["runs"].tolist() == [3, 2, 3, 1]
    assert pools.loc[(33.0, 14.0), "note"] == ""
    assert "2 of at least 3" in pools.loc[(14.0, 33.0), "note"]
    assert pools.loc[(-33.0, -14.0), "note"] == "ISO 4138: no turn to the other side"
    assert pools.loc[(33.0, 14.0), "radius_between_mm"] == pytest.approx(np.hypot(0.05, 0.0), rel=0.05)
    assert np.isnan(pools.loc[(33.0, 33.0), "radius_mm"])
    assert np.isfinite(pools.loc[(33.0, 33.0), "curvature_low_per_mm"])


def test_the_camera_is_no_part_of_the_scatter_but_of_the_interval() -> None:
    table = runs_of(33.0, 14.0, [7.8] * 3, RIGHT)
    (row,) = pool_runs(table).to_dict("records")
    assert row["radius_between_mm"] == 0.0
    assert row["radius_high_mm"] - 7.8 > 1.96 * 0.02


def test_backward_is_set_against_forward_of_the_same_speeds_with_an_interval() -> None:
    rng = np.random.default_rng(3)
    back = {"yaw_rate_deg_s": 20.0, "speed_mm_s": -2.0}
    forward = runs_of(33.0, 14.0, (8.0 + 0.02 * rng.normal(size=5)).tolist(), RIGHT)
    backward = runs_of(
        -33.0, -14.0, (7.6 + 0.02 * rng.normal(size=5)).tolist(), back, smoothness=[-3.0, -3.1, -2.9, -3.0, -3.0]
    )
    (row,) = compare_directions(pd.concat([backward, forward])).to_dict("records")
    assert row["radius_change_low_percent"] < -5.0 < row["radius_change_high_percent"] < 0
    assert row["smoothness_change"] == pytest.approx(-1.0)
    assert row["smoothness_change_high"] < 0


def test_runs_without_a_partner_or_a_result_are_not_compared() -> None:
    failed = runs_of(-33.0, -14.0, [np.nan], {"yaw_rate_deg_s": np.nan, "speed_mm_s": np.nan})
    assert compare_directions(pd.concat([runs_of(33.0, 14.0, [8.0], RIGHT), failed])).empty
    assert len(pool_runs(pd.concat([runs_of(33.0, 14.0, [8.0], RIGHT), failed]))) == 1


BACKWARD_RIGHT = {"yaw_rate_deg_s": 20.0, "speed_mm_s": -2.0}


def test_change_of_single_runs_is_in_percent_of_the_forward_one_with_both_uncertainties() -> None:
    """8.0 forward, 7.6 backward, each known to 0.04 mm: -5 %, known to √2 · 0.5 %. A camera's error cancels."""
    backward = runs_of(-33.0, -14.0, [7.6], BACKWARD_RIGHT, radius_random_mm=0.04, smoothness=-3.0)
    forward = runs_of(33.0, 14.0, [8.0], RIGHT, radius_random_mm=0.04)
    (row,) = compare_directions(pd.concat([backward, forward])).to_dict("records")
    names = ("forward_radius_mm", "backward_radius_mm", "forward_runs", "backward_runs", "smoothness_change")
    assert [row[name] for name in names] == pytest.approx([8.0, 7.6, 1, 1, -1.0])
    bounds = [row[f"radius_change{end}_percent"] for end in ("_low", "", "_high")]
    assert bounds == pytest.approx([-5 - 1.96 * 0.5 * np.sqrt(2), -5, -5 + 1.96 * 0.5 * np.sqrt(2)], rel=1e-3)
    assert np.isnan([row["smoothness_change_low"], row["smoothness_change_high"]]).all()


def test_straight_runs_are_compared_by_their_smoothness_alone() -> None:
    back = {"yaw_rate_deg_s": 0.1, "speed_mm_s": -2.0}
    pair = pd.concat([runs_of(33.0, 33.0, [900.0], RIGHT), runs_of(-33.0, -33.0, [800.0], back, smoothness=-2.5)])
    (row,) = compare_directions(pair).to_dict("records")
    assert np.isnan([row["forward_radius_mm"], row["radius_change_percent"]]).all()
    assert row["smoothness_change"] == pytest.approx(-0.5)


def test_row_of_a_command_holds_the_pooled_values_of_its_runs() -> None:
    table = runs_of(33.0, 14.0, [7.8, 8.0], RIGHT)
    table["speed_mm_s"], table["path_efficiency"] = [2.0, 2.2], [0.9, 1.0]
    (row,) = pool_runs(table).to_dict("records")
    assert (row["group"], row["direction"], row["radius_systematic_mm"]) == ("", "forward", pytest.approx(0.02))
    assert (row["radius_mm"], row["speed_mm_s"], row["path_efficiency"]) == pytest.approx((7.9, 2.1, 0.95))
    # Of two values the standard deviation is their difference over √2, the noise of one taken off.
    assert row["radius_between_mm"] == pytest.approx(np.sqrt(0.2**2 / 2 - 0.01**2))
    assert row["radius_within_mm"] == pytest.approx(0.01)
    assert row["speed_between_mm_s"] == pytest.approx(np.sqrt(0.2**2 / 2 - 0.001**2))
    assert row["path_efficiency_between"] == pytest.approx(0.1 / np.sqrt(2))
    assert row["p_same"] < 1e-6
    (one,) = pool_runs(runs_of(-33.0, -14.0, [7.8], BACKWARD_RIGHT)).to_dict("records")
    assert one["direction"] == "backward"
    assert (one["radius_low_mm"], one["radius_high_mm"]) == pytest.approx(
        (7.8 - 1.96 * np.hypot(0.01, 0.02), 7.8 + 1.96 * np.hypot(0.01, 0.02))
    )
    own = {"radius_low_mm": 7.73, "radius_high_mm": 7.92}  # not symmetrical: they are those of a curvature
    (same,) = pool_runs(runs_of(-33.0, -14.0, [7.8], BACKWARD_RIGHT, **own)).to_dict("records")
    assert {name: same[name] for name in own} == own  # one run had two intervals, 80 to 101 and 79 to 100 mm
    # Bounds of the curvature that lie 2e-4 apart hold 95 %.
    assert one["curvature_high_per_mm"] - one["curvature_low_per_mm"] == pytest.approx(2e-4)


@pytest.mark.parametrize(("radii", "disagree"), [([8.0, 11.9], False), ([8.0, 12.1], True), ([8.0, np.nan], False)])
def test_radii_half_as_large_again_are_no_repetitions(radii: list[float], disagree: bool) -> None:
    assert (disagreement(runs_of(33.0, 14.0, radii, RIGHT)) != "") == disagree


def test_runs_of_one_command_that_disagree_have_no_common_radius() -> None:
    (row,) = pool_runs(runs_of(33.0, 14.0, [7.8, 7.9, 15.77], RIGHT)).to_dict("records")
    assert np.isnan(row["radius_mm"])
    assert row["note"].startswith("runs disagree: radii from 7.8 to 15.77 mm")
    both = pd.concat([runs_of(33.0, 14.0, [7.8], RIGHT), runs_of(33.0, 14.0, [7.8], LEFT)])
    assert "they turn to both sides" in pool_runs(both)["note"][0]
    ways = pd.concat([runs_of(33.0, 14.0, [7.8], RIGHT), runs_of(33.0, 14.0, [7.8], BACKWARD_RIGHT)])
    assert "they drive forward and backward" in pool_runs(ways)["note"][0]


@pytest.mark.parametrize(
    ("speeds", "yaw_rates", "fault"),
    [
        ([0.3, 0.4], [0.2, 0.3], ""),
        ([0.3, 2.0], [0.2, 20.0], ""),
        ([0.3, -0.3], [0.2, -0.2], "they drive forward and backward"),
        ([0.3, 0.3], [0.2, -0.2], "they turn to both sides"),
        ([-0.3, -2.0], [0.2, 20.0], ""),
        ([-0.3, -0.3], [0.2, -0.2], "they turn to both sides"),
    ],
)
def test_ways_and_sides_of_runs_are_those_of_their_signs_however_slow_they_are(
    speeds: list[float], yaw_rates: list[float], fault: str
) -> None:
    runs = pd.DataFrame({"radius_mm": [8.0, 8.1], "speed_mm_s": speeds, "yaw_rate_deg_s": yaw_rates})
    assert disagreement(runs) == fault
