"""The slip law of a bench recording: least squares on the measured torques, with intervals.

Torques are fitted instead of forces: their noise is independent, and they are valid measurements also at slip angle 0,
where Eq. (9) does not determine the lateral force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.errors import SimulationError
from simulator.nominal_robot import Slip
from simulator.slip.bench import PAPER_APPARATUS, SIGMAS, Apparatus, forces_from_torques, torques

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

NAMES = (
    "longitudinal_friction",
    "lateral_friction",
    "friction_decrease",
    "longitudinal_shape",
    "lateral_shape",
    "longitudinal_stiffness",
    "lateral_stiffness",
)
DECREASE = NAMES.index("friction_decrease")
SHAPES = [NAMES.index("longitudinal_shape"), NAMES.index("lateral_shape")]
STEEPEST_SHAPE = 2.0  # largest shape factor: beyond it, friction at large slip would act along the sliding
MOST_FRICTION = 10.0  # no wheel has such friction, whereas a wrong unit makes a factor of a thousand
START_SHAPES = (0.7, 1.1, 1.5)  # initial values for which Eq. (6) rises, is level and falls at large slip


@dataclass(frozen=True)
class SlipFit:
    """A fitted slip law; value, low and high (7,) in the order of NAMES, with low and high bounding 95 %.

    misfit: root mean square of the residuals over their sigmas, 1 if the law explains the torques; intervals are
    widened by it if it exceeds 1. torque_sigma_mN_mm: standard uncertainties of wheel and disk torque used in the fit;
    sigmas_given: whether the recording states them; otherwise they are estimated from the residuals.
    """

    value: Array
    low: Array
    high: Array
    relative_sigma: Array
    misfit: float
    measurements: int
    torque_sigma_mN_mm: tuple[float, float]
    sigmas_given: bool

    @property
    def slip(self) -> Slip:
        """The law as the [slip] table of a robot.toml."""
        return Slip(**dict(zip(NAMES, (float(value) for value in self.value), strict=True)), stiffness_basis="load")


def fit_slip_law(table: pd.DataFrame, apparatus: Apparatus = PAPER_APPARATUS) -> SlipFit:
    """Fit mu0, K_mu, a and K of Eqs. (4) to (7) to a `checked_bench` recording, stiffness in proportion to load.

    Raises SimulationError if the recording has fewer torques than the law has parameters, or slip in one direction
    only. A parameter that the recording does not determine has an infinite interval.
    """
    _check_enough(table)
    _check_units(table, apparatus)
    wheel, disk = table["wheel_torque_mN_mm"].to_numpy(float), table["disk_torque_mN_mm"].to_numpy(float)
    given = SIGMAS[0] in table
    sigmas = [table[name].to_numpy(float) for name in SIGMAS] if given else _equal_sigmas(wheel, disk)

    def residuals(point: Array) -> Array:
        modelled = torques(_parameters(point), table, apparatus)
        return np.concatenate([(wheel - modelled[0]) / sigmas[0], (disk - modelled[1]) / sigmas[1]])

    found = _best(residuals, _starts(table, apparatus))
    if not given:
        for _ in range(3):  # estimate each meter's noise from its residuals; converges to 1 % in two rounds
            parts = np.split(residuals(found.x), 2)
            sigmas = [sigma * np.sqrt(np.mean(part**2)) for sigma, part in zip(sigmas, parts, strict=True)]
            found = _best(residuals, [found.x])
    used = (float(np.sqrt(np.mean(sigmas[0] ** 2))), float(np.sqrt(np.mean(sigmas[1] ** 2))))
    return _with_intervals(found, 2 * len(table), used, given)


def slip_toml(fit: SlipFit) -> str:
    """The [slip] table of a robot.toml, intervals as comments, and [tolerance] with the relative 1-sigma of each."""
    lines = ["[slip]"]
    for name, value, low, high in zip(NAMES, fit.value, fit.low, fit.high, strict=True):
        lines.append(f"{name} = {value:#.4g}".ljust(36) + f"# 95 %: {low:#.4g} to {high:#.4g}")
    lines += ['stiffness_basis = "load"', "", "[tolerance]"]
    for name, sigma in zip(NAMES, fit.relative_sigma, strict=True):
        if np.isfinite(sigma):
            lines.append(f'"slip.{name}" = {sigma:.2g}')
    return "\n".join(lines) + "\n"


def _check_enough(table: pd.DataFrame) -> None:
    if 2 * len(table) <= len(NAMES):
        raise SimulationError(
            f"a slip law has {len(NAMES)} parameters; {len(table)} rows with two torques each cannot determine them"
        )
    angle = np.radians(table["slip_angle_deg"].to_numpy(float))
    if not (np.abs(np.sin(angle)) > 0.05).any() or not (np.abs(np.cos(angle)) > 0.05).any():
        raise SimulationError("a slip law needs longitudinal and lateral slip; the recording has one direction only")


def _check_units(table: pd.DataFrame, apparatus: Apparatus) -> None:
    friction = float(forces_from_torques(table, apparatus)["longitudinal"].abs().median())
    if friction > MOST_FRICTION:
        raise SimulationError(
            f"half of the wheel torques imply friction of more than {friction:.3g} times the normal force; are "
            "torques in mN·mm and normal forces in mN?"
        )


def _equal_sigmas(wheel: Array, disk: Array) -> list[Array]:
    """Initial sigmas if none are given: 1 % of each meter's largest reading."""
    return [np.full(len(torque), 0.01 * np.abs(torque).max() + 1e-12) for torque in (wheel, disk)]


def _parameters(point: Array) -> Array:
    """Law parameters from fit variables: their logarithms, except K_mu, which may be 0."""
    with np.errstate(over="ignore"):  # an interval without an upper end is infinite
        values = np.exp(point)
    values[DECREASE] = point[DECREASE]
    return values


def _starts(table: pd.DataFrame, apparatus: Apparatus) -> list[Array]:
    """Initial values: frictions from the largest forces, stiffness from the slip at half of them."""
    forces = forces_from_torques(table, apparatus)
    along, across = (forces[name].abs().to_numpy() for name in ("longitudinal", "lateral"))
    peak_x, peak_y = max(np.nanmax(along), 1e-3), max(np.nanmax(across), 1e-3)
    starts = []
    for shape in START_SHAPES:
        level = np.sin(min(shape * np.pi / 2, np.pi / 2))
        values = np.array([peak_x / level, peak_y / level, 0.1, shape, shape, 10 * peak_x, 20 * peak_y])
        point = np.log(values)
        point[DECREASE] = values[DECREASE]
        starts.append(point)
    return starts


def _best(residuals: Any, starts: list[Array]) -> Any:
    from scipy.optimize import least_squares

    low, high = np.full(7, -8.0), np.full(7, 8.0)  # e^±8: beyond any wheel, without overflow
    low[DECREASE], high[DECREASE] = 0.0, 2.0
    high[SHAPES] = np.log(STEEPEST_SHAPE)
    inside = [np.clip(start, low + 1e-9, high - 1e-9) for start in starts]
    fits = [least_squares(residuals, start, bounds=(low, high), x_scale="jac") for start in inside]
    return min(fits, key=lambda fit: fit.cost)


def _sigmas(jacobian: Array) -> Array:
    """Standard uncertainty of each parameter; infinite where the residuals do not depend on it."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    seen = singular > 1e-9 * singular.max()  # far above rounding of the finite differences, far below any signal
    variance = np.sum((directions[seen] / singular[seen, None]) ** 2, axis=0)
    unseen = np.abs(directions[~seen]).max(axis=0, initial=0.0) > 1e-6
    return np.where(unseen, np.inf, np.sqrt(variance))


def _with_intervals(found: Any, measurements: int, sigma_used: tuple[float, float], given: bool) -> SlipFit:
    from scipy.special import stdtrit

    freedom = measurements - len(NAMES)
    misfit = float(np.sqrt(2 * found.cost / freedom))
    sigma = _sigmas(found.jac) * max(1.0, misfit)
    reach = float(stdtrit(freedom, 0.975)) * sigma  # Student's t
    low, high = _parameters(found.x - reach), _parameters(found.x + reach)
    low[DECREASE] = max(low[DECREASE], 0.0)
    value = _parameters(found.x)
    relative = sigma.copy()
    relative[DECREASE] = sigma[DECREASE] / value[DECREASE] if value[DECREASE] > 0 else np.nan
    for array in (value, low, high, relative):
        array.setflags(write=False)
    return SlipFit(value, low, high, relative, misfit, measurements, sigma_used, given)
