"""The slip evaluation apparatus of Section 3: torques of wheel and disk to friction forces, with their uncertainty.

The wheel, its axle fixed, stands on a turning disk at a distance R from the disk's axis. Wheel frame: x along the
wheel's rolling direction, y to its left; forces act on the wheel. Seen from the disk the wheel moves with
V = R·omega_disk at the slip angle alpha from its x axis, (u, v) = V·(cos alpha, sin alpha), and the disk runs the other
way under it.

Both torques are what the motors deliver (the meters stand between motor and wheel, motor and disk):

    T_w = r·f_x                                 the wheel is driven against the friction that pushes it forward
    T_D = -R·(f_x·cos alpha + f_y·sin alpha)    the disk takes the reaction, -f, along its own motion

so f_x = T_w/r and f_y = -(T_D/R + T_w·cos(alpha)/r)/sin(alpha). The fourth line of Eq. (9) agrees with this, with the
lateral force counted positive against a positive slip angle, as in Figures 7 and 8. The second line of Eq. (9) then
lacks a minus sign before R: without it, the disk's torque would have opposite signs in the two lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.errors import SimulationError
from simulator.nominal_robot import Slip
from simulator.slip.curves import BENCH_ANGLES_DEG, law_parameters, normalized_forces
from simulator.units import line_of, numbers_of

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

COLUMNS = ("slip_angle_deg", "wheel_rpm", "disk_rpm", "wheel_torque_mN_mm", "disk_torque_mN_mm", "normal_force_mN")
SIGMAS = ("wheel_torque_sigma_mN_mm", "disk_torque_sigma_mN_mm")
LATERAL_OK = "ok"
LATERAL_UNKNOWN = "slip angle 0: the lateral force does not act on the disk's torque"
ALONG = 1e-9  # |sin alpha| below which the slip angle counts as 0: less than 1e-7 degrees


@dataclass(frozen=True)
class Apparatus:
    """Radius r of the wheel and distance R of its contact from the disk's axis; the paper's by default."""

    wheel_radius_mm: float = 4.0
    contact_radius_mm: float = 38.0

    def __post_init__(self) -> None:
        """Refuse radii that are not positive."""
        for name, value in (("wheel radius", self.wheel_radius_mm), ("contact radius", self.contact_radius_mm)):
            if not (np.isfinite(value) and value > 0):
                raise SimulationError(f"{name} must be a positive number of millimetres; found {value}")


PAPER_APPARATUS = Apparatus()


def checked_bench(table: pd.DataFrame, name: str = "bench") -> pd.DataFrame:
    """The columns of a bench recording as numbers; SIGMAS only if both are present.

    Raises SimulationError for missing columns, cells that are not finite numbers, and forces or sigmas that are not
    positive.
    """
    missing = [column for column in COLUMNS if column not in table]
    if missing:
        raise SimulationError(f"{name}: lacks {', '.join(missing)}; a bench recording has {', '.join(COLUMNS)}")
    there = [column for column in SIGMAS if column in table]
    if len(there) == 1:
        raise SimulationError(
            f"{name}: has only {there[0]}; give the standard uncertainty of both torques or of neither"
        )
    columns = [*COLUMNS, *there]
    values = table[columns].apply(numbers_of).astype(float)
    for column in columns:
        fine = np.isfinite(values[column])
        if column in ("normal_force_mN", *SIGMAS):
            fine &= values[column] > 0
        if not fine.all():
            row = int(np.flatnonzero(~fine)[0])
            need = "a positive number" if column in ("normal_force_mN", *SIGMAS) else "a finite number"
            found = f"line {line_of(table, row)}, {column} = {table[column].iloc[row]}"
            raise SimulationError(f"{name}: {found} is not {need}")
    if values.empty:
        raise SimulationError(f"{name}: holds no measurement")
    checked: pd.DataFrame = values.reset_index(drop=True)
    return checked


def bench_slips(table: pd.DataFrame, apparatus: Apparatus = PAPER_APPARATUS) -> tuple[Array, Array]:
    """Slip ratio and slip angle in rad of every row, by Eq. (3) with the larger speed as denominator."""
    per_rpm = 2 * np.pi / 60
    speed = apparatus.contact_radius_mm * per_rpm * table["disk_rpm"].to_numpy(float)
    surface = apparatus.wheel_radius_mm * per_rpm * table["wheel_rpm"].to_numpy(float)
    angle = np.radians(table["slip_angle_deg"].to_numpy(float))
    u, v = speed * np.cos(angle), speed * np.sin(angle)
    larger = np.maximum(np.abs(u), np.abs(surface))
    ratio = np.divide(u - surface, larger, out=np.zeros_like(u), where=larger > 0)
    return ratio, np.arctan2(v, np.abs(u))


def forces_from_torques(table: pd.DataFrame, apparatus: Apparatus = PAPER_APPARATUS) -> pd.DataFrame:
    """Friction by Eq. (9): in mN in the wheel frame, and divided by the normal force with the signs of Figures 7 and 8.

    Columns: slip_ratio, slip_angle_deg, longitudinal_force_mN, lateral_force_mN, force_covariance_mN2 and their sigmas,
    longitudinal, lateral (over the normal force) and their sigmas, lateral_status. At slip angle 0 the lateral force is
    NaN with an infinite sigma, and the status says why. Without torque sigmas in the table all sigmas are NaN.
    """
    import pandas as pd

    r, radius = apparatus.wheel_radius_mm, apparatus.contact_radius_mm
    angle = np.radians(table["slip_angle_deg"].to_numpy(float))
    wheel, disk = table["wheel_torque_mN_mm"].to_numpy(float), table["disk_torque_mN_mm"].to_numpy(float)
    wheel_sigma, disk_sigma = (
        table[name].to_numpy(float) if name in table else np.full(len(table), np.nan) for name in SIGMAS
    )
    sin, cos = np.sin(angle), np.cos(angle)
    known = np.abs(sin) > ALONG
    sine = np.where(known, sin, np.nan)
    along, along_sigma = wheel / r, wheel_sigma / r
    across = -(disk / radius + along * cos) / sine
    across_sigma = np.where(known, np.hypot(disk_sigma / radius, along_sigma * cos) / np.abs(sine), np.inf)
    load = table["normal_force_mN"].to_numpy(float)
    return pd.DataFrame(
        {
            "slip_ratio": bench_slips(table, apparatus)[0],
            "slip_angle_deg": table["slip_angle_deg"].to_numpy(float),
            "longitudinal_force_mN": along,
            "longitudinal_force_sigma_mN": along_sigma,
            "lateral_force_mN": across,
            "lateral_force_sigma_mN": across_sigma,
            "force_covariance_mN2": -(along_sigma**2) * cos / sine,
            "longitudinal": -along / load,
            "longitudinal_sigma": along_sigma / load,
            "lateral": -across / load,
            "lateral_sigma": across_sigma / load,
            "lateral_status": np.where(known, LATERAL_OK, LATERAL_UNKNOWN),
        }
    )


def torques(parameters: Array, table: pd.DataFrame, apparatus: Apparatus = PAPER_APPARATUS) -> tuple[Array, Array]:
    """Torques, mN·mm, of the motors of wheel and disk under a slip law (`law_parameters`, (7,)), (n,) each."""
    ratio, angle = bench_slips(table, apparatus)
    along, across = normalized_forces(parameters, ratio, angle)
    load, turned = table["normal_force_mN"].to_numpy(float), np.radians(table["slip_angle_deg"].to_numpy(float))
    reaction = along * np.cos(turned) + across * np.sin(turned)
    return -apparatus.wheel_radius_mm * load * along, apparatus.contact_radius_mm * load * reaction


def virtual_bench(
    slip: Slip,
    rng: np.random.Generator,
    *,
    normal_force_mN: float = 2000.0,
    wheel_torque_sigma_mN_mm: float = 10.0,
    disk_torque_sigma_mN_mm: float = 40.0,
    wheel_rpm_step: float = 10.0,
    apparatus: Apparatus = PAPER_APPARATUS,
) -> pd.DataFrame:
    """Simulate the paper's measurement of a slip law: 20 to 180 rpm on a disk matched at 100 rpm, eight slip angles.

    The torques have Gaussian noise, by default 0.2 % of ranges of 5 and 20 mN·m. Columns: COLUMNS and SIGMAS.
    """
    import pandas as pd

    wheel_rpm = np.arange(20.0, 180.0 + wheel_rpm_step / 2, wheel_rpm_step)
    angle, wheel = (grid.ravel() for grid in np.meshgrid(BENCH_ANGLES_DEG, wheel_rpm, indexing="ij"))
    matched = 100.0 * apparatus.wheel_radius_mm / apparatus.contact_radius_mm
    table = pd.DataFrame({"slip_angle_deg": angle, "wheel_rpm": wheel, "disk_rpm": matched})
    table["normal_force_mN"] = normal_force_mN
    wheel_torque, disk_torque = torques(law_parameters(slip), table, apparatus)
    table["wheel_torque_mN_mm"] = wheel_torque + rng.normal(0.0, wheel_torque_sigma_mN_mm, len(table))
    table["disk_torque_mN_mm"] = disk_torque + rng.normal(0.0, disk_torque_sigma_mN_mm, len(table))
    table[SIGMAS[0]], table[SIGMAS[1]] = wheel_torque_sigma_mN_mm, disk_torque_sigma_mN_mm
    return table[[*COLUMNS, *SIGMAS]]
