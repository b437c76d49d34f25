"""Where measurement and model disagree: by direction, side, speed, heading, place, time and order, with significance.

Every run is cut into pieces of about a second; in each, the measured minus the predicted velocity is computed along and
across the robot and in yaw. Each of the three is regressed on quantities that it may depend on. Standard errors are
those of the jackknife over runs, because the pieces of a run are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

if TYPE_CHECKING:  # the report reads tables of pieces without a simulator
    from evaluator.diagnosis.likelihood.point import Point
    from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

PIECE_S = 1.0  # a turn of some degrees: long enough for a mean velocity, short enough for a heading
FEWEST_FREEDOM = 3  # runs beyond the coefficients
FEWEST_FRAMES = 5  # in a piece: a slope over fewer is mostly noise
SHOWN_SIGMAS = 3.5  # of 57 tests: chance exceeds this in one of forty experiments
FOLDS = {"heading": 1, "twice the heading": 2, "three times the heading": 3, "four times the heading": 4}

COLUMNS = (
    *("run", "time_s", "along_mm_s", "across_mm_s", "yaw_deg_s", "direction", "side", "speed_rpm"),
    *("difference_rpm", "heading_deg", "x_mm", "y_mm", "order"),
)

PLACE = ("heading_deg", "x_mm", "y_mm")

QUANTITIES = {"along_mm_s": "speed along the robot", "across_mm_s": "sideways speed", "yaw_deg_s": "yaw rate"}
UNITS = {"along_mm_s": "mm/s", "across_mm_s": "mm/s", "yaw_deg_s": "deg/s"}


Interval = tuple[float, float, float]  # value, low, high


@dataclass(frozen=True)
class Dependence:
    """A dependence of the disagreement: sizes with their significance, and a sentence.

    sizes: coefficients of the tested regressors, each with its 95 % bounds. rms: of their contribution over all pieces,
    in the unit of the quantity.
    """

    quantity: str
    by: str
    parity: str  # "even" or "odd" under reversal of the motion or of the side; "" if not applicable
    sigmas: float
    sentence: str
    sizes: tuple[Interval, ...] = ()
    rms: float = 0.0


def pieces(problem: Problem, point: Point, *, one_frame: bool = True) -> pd.DataFrame:
    """A row per piece of a run: disagreement along, across (mm/s) and in yaw (deg/s), and quantities it may depend on.

    Measured velocities are in the frame of the measured robot, predicted ones in that of the predicted robot, so that
    an earlier error of heading does not appear as sideways speed. one_frame: whether the runs share a frame; without
    it, place and heading are NaN.
    """
    rows = []
    for number, run in enumerate(problem.data):
        residual = problem.residuals([point.task(number)])[0]
        channels = problem.channels[number]
        end = run.time_s[-1] if run.stop_s is None else min(run.stop_s, run.time_s[-1])
        begin = max(run.start_s, run.time_s[0])
        count = max(int((end - begin) / PIECE_S), 1)
        command = run.run_command.command
        for low, high in pairwise(np.linspace(begin, end, count + 1)):
            inside = (run.time_s >= low) & (run.time_s <= high) & np.isfinite(residual).all(axis=1)
            if inside.sum() < FEWEST_FRAMES:
                continue
            left, right = (float(side) for side in command.at((low + high) / 2))
            speed = (left + right) / 2
            along, across, yaw = _velocity_misfit(run.time_s[inside], channels[inside], residual[inside], problem)
            rows.append(
                {
                    "run": run.id,
                    "time_s": (low + high) / 2 - begin,
                    "along_mm_s": along,
                    "across_mm_s": across,
                    "yaw_deg_s": np.degrees(yaw),
                    "direction": float(np.sign(speed)),
                    "side": float(np.sign(right - left)),
                    "speed_rpm": abs(speed),
                    "difference_rpm": abs(right - left),
                    "heading_deg": np.degrees(float(channels[inside][inside.sum() // 2, 2]) - np.pi / 2) % 360,
                    "x_mm": float(np.mean(channels[inside][:, 0])),
                    "y_mm": float(np.mean(channels[inside][:, 1])),
                    "order": run.order,
                }
            )
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    return table if one_frame else table.assign(**dict.fromkeys(PLACE, np.nan))


def _velocity_misfit(
    time_s: Floats, channels: Floats, residual: Floats, problem: Problem
) -> tuple[float, float, float]:
    """Measured minus predicted speed along and across, mm/s, and yaw rate, rad/s, over one piece of a run."""
    time = time_s - time_s.mean()
    off = time @ residual[:, :3] / (time @ time)
    predicted = time @ (channels[:, :2] - residual[:, :2]) / (time @ time)
    heading = float(channels[len(time) // 2, 2]) - np.pi / 2
    turned = float(np.mean(residual[:, 2])) / problem.half_distance_mm  # measured minus predicted heading
    body_from_plate = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    back = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    along, across = body_from_plate @ (off[:2] + predicted) - body_from_plate @ back @ predicted
    return float(along), float(across), float(off[2] / problem.half_distance_mm)


def dependences(table: pd.DataFrame) -> list[Dependence]:
    """All significant dependences, most significant first."""
    shown = [item for item in every_dependence(table) if item.sigmas >= SHOWN_SIGMAS]
    return sorted(shown, key=lambda item: -item.sigmas)


def most_telling(table: pd.DataFrame) -> list[Dependence]:
    """All significant dependences; if there are none, the most significant of all tested ones."""
    asked = [item for item in every_dependence(table) if item.sigmas > 0]
    return dependences(table) or sorted(asked, key=lambda item: -item.sigmas)[:1]


def every_dependence(table: pd.DataFrame) -> list[Dependence]:
    """All dependences that these runs can test, significant or not."""
    found = []
    runs = table["run"].to_numpy()
    known: dict[bytes, _Clusters] = {}  # of regressors, which most quantities share
    for quantity in QUANTITIES:
        values = table[quantity].to_numpy(dtype=float)
        for (by, parity), (common, tested) in _designs(table, quantity).items():
            columns = np.column_stack([*common, *tested])
            if not np.isfinite(columns).all() or np.linalg.matrix_rank(columns) < columns.shape[1]:
                continue
            if (key := columns.tobytes()) not in known:
                known[key] = _clusters(columns, runs)
            size, half, sigmas = _clustered(values, columns, known[key], len(tested))
            sizes = tuple((v, v - h, v + h) for v, h in zip(map(float, size), map(float, half), strict=True))
            sentence = _sentence(quantity, by, parity, size, sigmas)
            rms = float(np.sqrt(np.mean((np.column_stack(tested) @ size[-len(tested) :]) ** 2)))
            found.append(Dependence(quantity, by, parity, sigmas, sentence, sizes[-len(tested) :], rms))
    return found


Regressors = list[Floats]


def _designs(table: pd.DataFrame, quantity: str) -> dict[tuple[str, str], tuple[Regressors, Regressors]]:
    """Regressors by dependence and parity under reversal of the motion: common ones, and those tested.

    Errors of slipping wheels grow with speed: regressors in heading, position or order are therefore scaled by the
    speed over its mean, so that sizes hold at the mean speed. An external force is even: it does not change when the
    robot drives backward; an error of the wheels or of the scale is odd.
    """
    one = np.ones(len(table))
    column = {str(name): table[name].to_numpy(dtype=float) for name in table if name != "run"}
    direction, side = column["direction"], column["side"]
    motion = side if quantity == "yaw_deg_s" else direction
    fast = column["speed_rpm"] / max(float(column["speed_rpm"].mean()), 1e-9)
    angle = np.radians(column["heading_deg"])
    over = {
        **{by: [np.cos(fold * angle), np.sin(fold * angle)] for by, fold in FOLDS.items()},
        "place": [column["x_mm"], column["y_mm"]],
    }
    first = np.where(column["time_s"] < PIECE_S, 1.0, 0.0)
    return {
        ("everywhere", "even"): ([], [one]),
        ("forward and backward", "odd"): ([one], [direction]),
        ("left and right", "odd"): ([one], [side]),
        ("direction times side", ""): ([one, direction, side], [direction * side]),
        ("speed", "odd"): ([one, motion], [motion * column["speed_rpm"]]),
        ("difference of the wheels", "odd"): ([one, side], [side * column["difference_rpm"]]),
        **{(by, "even"): ([one], [fast * item for item in basis]) for by, basis in over.items()},
        **{(by, "odd"): ([one, direction], [direction * fast * item for item in basis]) for by, basis in over.items()},
        ("the first second", "odd"): ([one, motion], [motion * first]),
        ("time since the command", ""): ([one], [column["time_s"]]),
        ("order of the runs", "odd"): ([one, motion], [motion * fast * column["order"]]),
    }


def root_mean_squares(table: pd.DataFrame) -> dict[str, Interval]:
    """Size of each disagreement: RMS over all pieces with 95 % bounds from the scatter over runs.

    The bounds are those of its logarithm: a mean square is skewed, and never 0 where the pieces disagree.
    """
    squares = (table[list(QUANTITIES)] ** 2).groupby(table["run"]).mean()
    reach = float(special.stdtrit(max(len(squares) - 1, 1), 0.975)) / np.sqrt(len(squares))
    found = {}
    for name in QUANTITIES:
        mean, spread = float(squares[name].mean()), float(squares[name].std(ddof=1)) * reach
        factor = np.exp(0.5 * spread / mean) if mean > 0 else 1.0
        found[name] = (np.sqrt(mean), np.sqrt(mean) / factor, np.sqrt(mean) * factor)
    return found


@dataclass(frozen=True)
class _Clusters:
    """What least squares and its jackknife over runs need of the regressors (n, p) alone.

    inverse: (p, p) of their normal matrix. freedom: runs less coefficients. of_run: rows of each run, and the matrix
    (p, rows) of its score; of no run if there are too few.
    """

    inverse: Floats
    freedom: int
    of_run: list[tuple[NDArray[np.bool_], Floats]]


def _clusters(columns: Floats, runs: NDArray[np.object_]) -> _Clusters:
    inverse = np.asarray(np.linalg.pinv(columns.T @ columns), dtype=float)
    names, of_run = np.unique(runs), []
    freedom = len(names) - columns.shape[1]
    for name in names if freedom >= FEWEST_FREEDOM else ():
        rows = runs == name
        own = columns[rows]
        leverage_left = np.eye(len(own)) - own @ inverse @ own.T
        of_run.append((rows, own.T @ np.linalg.pinv(leverage_left, rcond=1e-9, hermitian=True)))
    return _Clusters(inverse, freedom, of_run)


def _clustered(values: Floats, columns: Floats, clusters: _Clusters, tested: int) -> tuple[Floats, Floats, float]:
    """Least squares: all coefficients, half their 95 % intervals, joint significance of those tested (last) in sigmas.

    Errors are those of the jackknife over runs, which few runs do not make too small: Bell & McCaffrey (2002), Survey
    Methodology 28, 169.
    """
    inverse, freedom, count = clusters.inverse, clusters.freedom, len(clusters.of_run)
    size = inverse @ columns.T @ values
    left = values - columns @ size
    if freedom < FEWEST_FREEDOM:
        return size, np.full(len(size), np.inf), 0.0
    spread = np.array([score @ left[rows] for rows, score in clusters.of_run])
    covariance = inverse @ (spread.T @ spread) @ inverse * (count - 1) / count
    part = covariance[-tested:, -tested:]
    ratio = float(size[-tested:] @ np.linalg.pinv(part) @ size[-tested:]) / tested
    probability = float(special.fdtrc(tested, freedom, ratio))
    half = float(special.stdtrit(freedom, 0.975)) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return size, half, -float(special.ndtri(max(probability, 1e-300) / 2))


def _sentence(quantity: str, by: str, parity: str, size: Floats, sigmas: float) -> str:
    what, unit = QUANTITIES[quantity], UNITS[quantity]
    tail = f" ({sigmas:.0f} sigmas)"
    value = float(size[-1])
    reversing = ", with the opposite sign when driving backward" if parity == "odd" else ", whichever way it drives"
    if by == "everywhere":
        return f"measured {what} is off by {value:+.3g} {unit} in all runs together{tail}"
    if by in ("forward and backward", "left and right"):
        first, second = size[0] + value, size[0] - value
        one, other = ("forward", "backward") if by == "forward and backward" else ("in left", "in right turns")
        if quantity == "along_mm_s" and one == "forward":
            one, other = f"forward ({_pace(first)})", f"backward ({_pace(-second)})"
        return f"measured {what} is off by {first:+.3g} {unit} {one} and {second:+.3g} {unit} {other}{tail}"
    if by in FOLDS:
        fold = FOLDS[by]
        peak = round(float(np.degrees(np.arctan2(size[-1], size[-2])) / fold % (360 / fold)))
        at = " and ".join(str(peak + 360 * turn // fold) for turn in range(fold)) + " degrees"
        height = float(np.hypot(size[-2], size[-1]))
        return f"measured {what} varies with {by}: {height:.3g} {unit} more at {at}{reversing}{tail}"
    if by == "place":
        across = f"{size[-2]:+.2g} {unit} per mm in x, {size[-1]:+.2g} in y"
        return f"measured {what} changes across the plate: {across}{reversing}{tail}"
    opposite = f"with the opposite sign {'in right turns' if quantity == 'yaw_deg_s' else 'when driving backward'}"
    amount = f"{value:+.3g} {unit}"
    change = {
        "speed": f"changes by {amount} per rpm of mean wheel speed, {opposite}",
        "difference of the wheels": f"changes by {amount} per rpm of difference of the wheel speeds, with the opposite "
        "sign in right turns",
        "the first second": f"is off by {amount} in the first second after the command, {opposite}",
        "time since the command": f"changes by {amount} per second since the command",
        "order of the runs": f"changes by {amount} from each run to the next, {opposite}",
        "direction times side": f"is off by {amount} in forward left and backward right turns, with the opposite sign "
        "in the others",
    }[by]
    return f"measured {what} {change}{tail}"


def _pace(gain: float) -> str:
    return "faster" if gain > 0 else "slower"
