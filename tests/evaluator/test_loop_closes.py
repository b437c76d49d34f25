"""The loop closes: a robot file with an effect, compared with runs of a robot that has it, leaves no gap."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.comparison import simulated_poses, trajectory_gap
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses, poses_from_marks
from evaluator.settings import Run
from simulator.command import Command
from simulator.effects.catalogue import BUILT_IN
from simulator.effects.entry import EffectEntry
from simulator.observation import marks_of_run, view_of
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate

# A size that shows in every effect, and one of the other sign where it has one.
SIZES: dict[str, dict[str, float]] = {
    "drive-speed-mismatch": {"left_over_right": 1.04},
    "drive-speed-scale": {"factor": 0.96},
    "motor-droop": {"rpm_per_uN_mm": 3e-3},
    "command-lag": {"dead_time_s": 0.1, "time_constant_s": 0.15},
    "speed-ripple": {"amplitude": 0.08, "phase_deg": 40.0},
    "dead-band": {"rpm": 20.0},
    "sliding-friction": {"share": 1.0},
    "speed-limit": {"wheel_rpm": 25.0, "ahead_rpm": 22.0, "turn_rpm": 5.0},
    "acceleration-limit": {"ahead_rpm_s": 60.0, "turn_rpm_s": 30.0},
    "friction-across": {"factor": 1.5},
    "speed-drift": {"per_run": 0.01},
    "magnet-imbalance": {"left_over_right": 1.4},
    "magnet-strength": {"driving_factor": 0.7, "driven_factor": 1.5},
    "friction-level": {"factor": 0.7},
    "wheel-toe": {"left_deg": 3.0, "right_deg": 1.0},
    "rolling-drag": {"coefficient": 0.06},
    "scrub-torque": {"radius_mm": 0.15},
    "axle-compliance": {"deg_per_mN": 1.1},
    "mass-offset": {"x_mm": 1.2, "y_mm": -0.8},
    "plate-tilt": {"angle_deg": 8.0, "azimuth_deg": 30.0},
    "tether-pull": {"x_mN": 0.5, "y_mN": -0.6},
    "tether-spring": {"stiffness_mN_mm": 0.04, "anchor_x_mm": 15.0, "anchor_y_mm": -10.0},
    "viscous-drag": {"force_mN_s_mm": 0.2, "moment_uN_mm_s": 2000.0},
    "friction-gradient": {"per_mm_x": 0.01, "per_mm_y": -0.008},
    "friction-grain": {"amplitude": 0.2, "direction_deg": 25.0},
    "stray-magnet": {"force_mN": 2.0, "x_mm": 8.0, "y_mm": 6.0, "exponent": 2.0},
    "mark-offset": {"x_mm": 0.4, "y_mm": -0.3, "angle_deg": 3.0},
    "plane-scale": {"factor": 1.03},
    "time-base": {"factor": 1.03},
    "camera-tilt": {"per_mm_x": 1.2e-3, "per_mm_y": -1e-3},
    "rolling-shutter": {"x_ms_per_mm": -4.0, "y_ms_per_mm": 3.0},  # seen late: else the robot moves before its start
}
OPPOSITE = {
    "drive-speed-mismatch": {"left_over_right": 0.96},
    "drive-speed-scale": {"factor": 1.04},
    "speed-drift": {"per_run": -0.01},
    "magnet-imbalance": {"left_over_right": 0.7},
    "friction-level": {"factor": 1.3},
    "wheel-toe": {"left_deg": -3.0, "right_deg": -1.0},
    "axle-compliance": {"deg_per_mN": -1.1},
    "mass-offset": {"x_mm": -1.2, "y_mm": 0.8},
    "plate-tilt": {"angle_deg": 8.0, "azimuth_deg": 210.0},
    "tether-pull": {"x_mN": -0.5, "y_mN": 0.6},
    "friction-gradient": {"per_mm_x": -0.01, "per_mm_y": 0.008},
    "mark-offset": {"x_mm": -0.4, "y_mm": 0.3, "angle_deg": -3.0},
    "plane-scale": {"factor": 0.97},
    "time-base": {"factor": 0.97},
    "camera-tilt": {"per_mm_x": -1.2e-3, "per_mm_y": 1e-3},
    "rolling-shutter": {"x_ms_per_mm": 4.0, "y_ms_per_mm": -3.0},
}
COMMANDS = [(33.3, 14.4), (14.4, -33.3)]
START_S, RUN_INDEX = 0.5, 3


def _with(effects: dict[str, dict[str, float]]) -> Robot:
    entries = tuple(EffectEntry.model_validate({"id": name, **values}) for name, values in effects.items())
    return load_robot("barrel").model_copy(update={"effect": entries})


def _measured(robot: Robot, command: tuple[float, float]) -> tuple[Run, Poses]:
    """A run of the robot as a tracker would write it, without noise."""
    true_s = np.arange(0.0, 4.5, 1 / 20)
    factor = view_of(robot).time_factor
    motion = simulate(
        robot, Command.constant(*command, start_s=START_S), true_s, State(4.0, -3.0, 0.7), run_index=RUN_INDEX
    )
    marks: pd.DataFrame = marks_of_run(robot, motion)
    run = Run.model_validate(
        {
            "id": "r",
            "left_rpm": command[0],
            "right_rpm": command[1],
            "start_s": START_S * factor,  # in the time of the recording
            "marks": "r.csv",
        }
    )
    return run, poses_from_marks(marks, MarkGeometry.of_robot(load_robot("barrel")))


def _gap(measured_with: Robot, model: Robot) -> float:
    gaps = []
    for command in COMMANDS:
        run, poses = _measured(measured_with, command)
        _, seen = simulated_poses(model, run.run_command(), poses, RUN_INDEX)
        gaps.append(trajectory_gap(poses, seen)["gap_rms_mm"])
    return float(np.sqrt(np.mean(np.square(gaps))))


def test_every_effect_of_the_catalogue_is_asked() -> None:
    assert set(SIZES) == set(BUILT_IN)


@pytest.mark.parametrize("effect", sorted(SIZES))
def test_a_robot_with_its_effect_leaves_no_gap_and_without_it_leaves_one(effect: str) -> None:
    robot = _with({effect: SIZES[effect]})
    without, closed = _gap(robot, load_robot("barrel")), _gap(robot, robot)
    # mm, over four seconds: a tracker sees a thousandth; what belongs to open ground hardly shows on the plate
    assert without > (1e-4 if BUILT_IN[effect].of_ground else 1e-3)
    assert closed < 0.02 * without
    if effect in OPPOSITE:
        assert _gap(robot, _with({effect: OPPOSITE[effect]})) > 1.1 * without


@pytest.mark.parametrize(
    "pair", [("plane-scale", "drive-speed-mismatch"), ("mark-offset", "axle-compliance"), ("time-base", "plate-tilt")]
)
def test_the_loop_closes_for_pairs_of_what_is_seen_and_what_acts(pair: tuple[str, str]) -> None:
    robot = _with({name: SIZES[name] for name in pair})
    without = _gap(robot, load_robot("barrel"))
    assert _gap(robot, robot) < 0.02 * without
    for name in pair:  # either alone is not enough
        assert _gap(robot, _with({name: SIZES[name]})) > 0.1 * without
