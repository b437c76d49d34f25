"""Columns of the tables that turnscope writes, for the page of file formats.

MARK and WHEEL stand for names of robot.toml. A table of turning results is described by its model instead (formats.py).
"""

from __future__ import annotations

Columns = dict[str, str]

# Columns of turning.csv that are no field of its model, or several.
OF_MARKS: Columns = {
    "mark_speeds_mm_s": "`MARK_speed_mm_s`",
    "mark_radii_mm": "`MARK_radius_mm`",
    "paths": "of a robot with a single mark `MARK_radius_mm`, `MARK_radius_low_mm`, `MARK_radius_high_mm` and "
    "`MARK_speed_mm_s`",
}
OF_PHASES = ("phase", "phase_start_s", "phase_stop_s", "late_s", "late_low_s", "late_high_s", "rise_s", "hidden_rise_s")
GROUPED = (
    "`group` is that of the run in experiment.toml. A run with a command log has a row for each phase of constant "
    f"command, and the columns {', '.join(f'`{name}`' for name in OF_PHASES)}."
)

MARKS: Columns = {
    "time_s": "time of the frame in the recording",
    "frame": "number of the frame in the recording, from 0",
    "MARK_x_mm, MARK_y_mm": "centre of a mark in the plate frame, on the plane of the marks; empty if it was not found",
    "MARK_x_sigma_mm, MARK_y_sigma_mm, MARK_xy_cov_mm2": "its standard uncertainties from tracking, and covariance",
    "MARK_status": "`ok`, `corrected` (by hand), or why the mark has no centre in this frame",
    "MARK_x_px, MARK_y_px": "centre in the image; only of a video",
    "MARK_x_sigma_px, MARK_y_sigma_px, MARK_xy_cov_px2": "the same uncertainties in the image",
}
POSES: Columns = {
    "time_s": "time of the frame in the recording",
    "x_mm, y_mm, heading_deg": "pose of the robot's centre in the plate frame; empty without a pose",
    "x_sigma_mm, y_sigma_mm, heading_sigma_deg": "standard uncertainties from tracking",
    "status": "`ok`, or why the frame has no pose",
}
SIMULATED: Columns = {
    "time_s": "time of the frame in the recording",
    "x_mm, y_mm, heading_deg": "simulated pose of the robot's centre, from the measured start pose",
    "u_mm_s, v_mm_s, yaw_rate_deg_s": "velocity forward and to the left in the body frame, and yaw rate",
    "WHEEL_slip_ratio, WHEEL_slip_angle_deg": "slip of each wheel",
    "WHEEL_longitudinal_force_mN, WHEEL_lateral_force_mN": "friction on each wheel, forward and to the left",
}
COMPARISON: Columns = {
    "run, left_rpm, right_rpm, group": "as in turning.csv",
    "radius_mm, radius_low_mm, radius_high_mm": "measured, as in turning.csv",
    "simulated_radius_mm, radius_difference_percent": "of the simulated run; simulated relative to measured",
    "steady_radius_mm, steady_radius_low_mm, steady_radius_high_mm": "of the steady turn as a whole, measured",
    "simulated_steady_radius_mm, steady_radius_difference_percent": "the same for the steady turn",
    "speed_mm_s, yaw_rate_deg_s, body_slip_angle_deg": "measured, as in turning.csv",
    "MARK_speed_mm_s": "measured speed of each mark",
    "MARK_radius_mm, MARK_radius_low_mm, MARK_radius_high_mm, MARK_radius_difference_percent": "of a single mark",
    "front_left_slip_ratio, front_right_slip_ratio, WHEEL_slip_angle_deg": "measured slip of wheels",
    "simulated_NAME": "simulated value of any of these columns",
    "gap_rms_mm, gap_end_mm": "distance of simulated and measured centre (or single mark): RMS, and at the end",
    "heading_gap_end_deg": "simulated minus measured heading at the end of the run",
}
POOLED: Columns = {
    "group, left_rpm, right_rpm": "command whose repetitions are pooled",
    "side, direction": "`left` or `right`, empty if straight; `forward` or `backward`",
    "runs": "number of runs with results",
    "radius_mm, radius_low_mm, radius_high_mm": "mean radius; its 95 % interval includes the three that follow",
    "radius_between_mm": "standard deviation from run to run, measurement uncertainty subtracted",
    "radius_within_mm": "standard uncertainty of a single run from noise",
    "radius_systematic_mm": "standard uncertainty that all runs share, from the camera and the marks on the robot",
    "p_same": "probability that the runs scatter as much if their radii are equal",
    "curvature_per_mm, curvature_low_per_mm, curvature_high_per_mm": "mean curvature with its 95 % interval",
    "speed_mm_s, path_efficiency, smoothness": "means, as in turning.csv",
    "speed_between_mm_s, path_efficiency_between, smoothness_between": "their standard deviations from run to run",
    "note": "what ISO 4138 requires beyond these runs, and why contradicting runs have no common radius",
}
DIRECTIONS: Columns = {
    "group, left_rpm, right_rpm": "forward command that was also driven backward",
    "forward_runs, backward_runs": "number of runs in each direction",
    "forward_radius_mm, backward_radius_mm": "mean radii; empty for straight runs",
    "radius_change_percent, radius_change_low_percent, radius_change_high_percent": "backward against forward, 95 %",
    "forward_smoothness, backward_smoothness": "means, as in turning.csv",
    "smoothness_change, smoothness_change_low, smoothness_change_high": "backward minus forward, 95 %",
}
DISAGREEMENT: Columns = {
    "run, time_s, order": "run, time of the middle of the piece since the command, number of the run in the session",
    "along_mm_s, across_mm_s, yaw_deg_s": "measured minus simulated velocity along and across the robot, and yaw rate",
    "direction, side": "1 forward, −1 backward; sign of the right minus the left command",
    "speed_rpm, difference_rpm": "mean of both commands, and their difference, as absolute values",
    "heading_deg, x_mm, y_mm": "place on the plate; empty for runs without a common frame",
    "after_along_mm_s, after_across_mm_s, after_yaw_deg_s": "what remains with the answer of the diagnosis",
    "kept_aside": "whether the run was held out",
}
PROVENANCE: Columns = {
    "format, turnscope, code_sha256, python, libraries": "versions of the program, its code and its libraries",
    "command_line": "the command as it was typed",
    "experiment, settings": "name and content of experiment.toml as it was read",
    "inputs_sha256": "hash of every input file, by its path relative to experiment.toml",
    "changed_meanwhile": "files that changed during the analysis; only if there are any",
}

FILES: tuple[tuple[str, str, Columns], ...] = (
    ("marks/RUN.csv", "The tracked marks of a run, a row per frame.", MARKS),
    ("poses/RUN.csv", "The measured motion of a run, a row per frame.", POSES),
    ("simulated/RUN.csv", "The simulated counterpart of a run, a row per frame of the recording.", SIMULATED),
    ("comparison.csv", "A row per run: measured beside simulated values.", COMPARISON),
    ("pooled.csv", "A row per command: its repetitions pooled.", POOLED),
    ("directions.csv", "A row per command that was driven forward and backward.", DIRECTIONS),
    ("disagreement.csv", "The residuals of a diagnosis, a row per second of a run.", DISAGREEMENT),
    ("provenance.json", "What the results were made from. It holds no time and no host name.", PROVENANCE),
)


def result_tables() -> str:
    """The part of the page on these files."""
    parts = []
    for name, purpose, columns in FILES:
        rows = "".join(
            f"| {', '.join(f'`{key}`' for key in keys.split(', '))} | {words} |\n" for keys, words in columns.items()
        )
        head = "| key | |" if name.endswith(".json") else "| column | |"
        parts.append(f"## {name}\n\n{purpose}\n\n{head}\n|---|---|\n{rows}".rstrip())
    return "\n\n".join(parts)
