"""What others predict from commands: ideal wheels, a yaw factor, instantaneous centres of rotation, a Gaussian process.

Each gives the pose (n, 3) at the last sample of every window: x and y in m, heading in rad, from the window's start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares, minimize

from tests.driven_robot.drive import Drive

Array = NDArray[np.float64]
LENGTH = 0.5  # logarithm of the usual length of the process, in standard deviations of the commands
WIDEST = 6.0  # bounds of the logarithms of sizes and lengths: a factor of 400 either way
# A robot on ground slips, bumps and is pushed now and then: Student's t of few degrees of freedom, in two passes.
FREEDOM, PASSES, SIGMAS_PER_MEDIAN = 4.0, 2, 1.4826
SIGMAS = np.array([0.2, 0.2, 0.15])  # m, m, rad: what a good prediction leaves; weighs position against heading


def wrapped(angle: Array) -> Array:
    """Angles in -π … π."""
    return np.asarray(np.angle(np.exp(1j * angle)))


def rolled(twist: Array, interval_s: float) -> Array:
    """Last pose (n, 3) of velocities (n, m, 3), forward, left and yaw rate, held from sample to sample."""
    heading = np.cumsum(twist[..., 2], axis=1) * interval_s
    middle = heading - twist[..., 2] * interval_s / 2
    ahead, left = twist[..., 0], twist[..., 1]
    x = (ahead * np.cos(middle) - left * np.sin(middle)).sum(axis=1) * interval_s
    y = (ahead * np.sin(middle) + left * np.cos(middle)).sum(axis=1) * interval_s
    return np.stack([x, y, heading[:, -1]], axis=1)


def differential(drive: Drive, radius_m: float, track_m: float, yaw: float = 1.0, encoders: bool = False) -> Array:
    """Wheels that roll without slip, the yaw rate multiplied by a factor."""
    speed = radius_m * (drive.encoder_rad_s if encoders else drive.command_rad_s)[:, :-1]
    ahead = speed.mean(axis=2)
    return rolled(
        np.stack([ahead, 0 * ahead, yaw * (speed[..., 1] - speed[..., 0]) / track_m], axis=2), drive.interval_s
    )


def best_yaw_factor(drive: Drive, radius_m: float, track_m: float, fitted: NDArray[np.bool_]) -> Array:
    """Differential drive with the one yaw factor of least robust misfit on the fitted windows."""
    factors = np.linspace(0.05, 1.5, 146)
    cost = [misfit(differential(drive, radius_m, track_m, yaw), drive)[fitted] for yaw in factors]
    return differential(drive, radius_m, track_m, float(factors[int(np.argmin([robust(part) for part in cost]))]))


def misfit(pose: Array, drive: Drive) -> Array:
    """Predicted minus measured last pose (n, 3), in SIGMAS; headings the short way round."""
    off = pose - drive.pose[:, -1]
    off[:, 2] = wrapped(off[:, 2])
    return np.asarray(off / SIGMAS)


def robust(values: Array) -> float:
    """A cost that grows as the square of small values and in proportion to large ones (Huber's, smoothed)."""
    return float((np.sqrt(1 + values**2) - 1).sum())


def rotation_centres(drive: Drive, radius_m: float, track_m: float, fitted: NDArray[np.bool_]) -> Array:
    """Instantaneous centres of rotation of the left and right treads and of the body, and a gain of either side.

    Source: Mandow et al. (2007), Experimental kinematics for wheeled skid-steer mobile robots, IROS; five constants.
    """

    def pose(free: Array) -> Array:
        left, right = np.moveaxis(radius_m * drive.command_rad_s[:, :-1] * free[3:], 2, 0)
        width = free[0] - free[1]
        yaw = (right - left) / width
        twist = np.stack([(right * free[0] - left * free[1]) / width, -yaw * free[2], yaw], axis=2)
        return rolled(twist, drive.interval_s)

    def cost(free: Array) -> Array:
        return misfit(pose(free), drive)[fitted].ravel()

    start = np.array([track_m, -track_m, 0.0, 1.0, 1.0])
    found = least_squares(cost, start, loss="soft_l1", bounds=([0.01, -30, -9, 0, 0], [30, -0.01, 9, 9, 9]))
    return pose(found.x)


def with_process(pose: Array, drive: Drive, fitted: NDArray[np.bool_], more: Array | None = None) -> Array:
    """A prediction plus a Gaussian process of what it leaves, over commands before and during the window.

    more: further inputs (n, k). Squared exponential with a length for each input, noise and size by marginal
    likelihood; one process a component. Heavy tails by reweighting, as under Student's t.
    """
    inputs = np.hstack([drive.mean_commands(begin, begin + 1.0) for begin in (-1.0, 0.0, 1.0)])
    if more is not None:
        inputs = np.hstack([inputs, more])
    inputs = inputs / inputs.std(axis=0)
    left = -misfit(pose, drive)
    result = pose.copy()
    for component in range(3):
        values, weights = left[fitted, component], np.ones(int(fitted.sum()))
        for _ in range(PASSES):
            mean = _process(inputs[fitted], values, weights, inputs)
            off = values - mean[fitted]
            weights = (FREEDOM + 1) / (FREEDOM + (off / (SIGMAS_PER_MEDIAN * np.median(np.abs(off)))) ** 2)
        result[:, component] += SIGMAS[component] * mean
    return result


def _process(inputs: Array, values: Array, weights: Array, asked: Array) -> Array:
    """Posterior mean at `asked` of a process with values (k,) of weights (k,) at inputs (k, d)."""
    count, mean = len(values), float(values @ weights / weights.sum())
    squares = (inputs[:, None] - inputs[None]) ** 2
    off = values - mean

    def cost(free: Array) -> tuple[float, Array]:
        """Minus the logarithm of the marginal likelihood and of a weak prior of the lengths, and its gradient."""
        lengths = np.exp(-2 * free[2:])
        smooth = np.exp(2 * free[0] - 0.5 * squares @ lengths)
        noise = np.exp(2 * free[1]) / weights
        factor = cho_factor(smooth + np.diag(noise), lower=True)
        solved = cho_solve(factor, off)
        slope = 0.5 * (cho_solve(factor, np.eye(count)) - np.outer(solved, solved))
        weighed = slope * smooth
        gradient = [2 * weighed.sum(), 2 * float(np.diag(slope) @ noise)]
        gradient += list(np.einsum("ij,ijk->k", weighed, squares) * lengths + free[2:] - LENGTH)
        value = 0.5 * off @ solved + np.log(np.diag(factor[0])).sum() + 0.5 * ((free[2:] - LENGTH) ** 2).sum()
        return float(value), np.array(gradient)

    size = np.log(values.std() + 1e-9)
    start = np.r_[size, size - 0.5, np.full(inputs.shape[1], LENGTH)]
    # a first step along a steep slope may leave the range of numbers: of 300 windows of a Warthog on gravel, it did
    bounds = [(middle - WIDEST, middle + WIDEST) for middle in start]
    found = minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 40}).x
    lengths = np.exp(-2 * found[2:])
    matrix = np.exp(2 * found[0] - 0.5 * squares @ lengths) + np.diag(np.exp(2 * found[1]) / weights)
    across = np.exp(2 * found[0] - 0.5 * (asked[:, None] - inputs[None]) ** 2 @ lengths)
    return np.asarray(mean + across @ np.linalg.solve(matrix, off))
