"""Slip characteristics: friction over vertical force against slip ratio and slip angle, as in Figures 3, 7 and 8.

Signs follow the figures: a braking force (positive slip ratio) and a force against a positive slip angle are positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.compilation import compiled
from simulator.nominal_robot import Slip
from simulator.slip.law import wheel_force

if TYPE_CHECKING:
    import pandas as pd

SLIP_RATIOS = np.linspace(0.0, 1.0, 101)
SLIP_ANGLES_DEG = np.linspace(0.0, 90.0, 181)
BENCH_ANGLES_DEG = (0.0, 7.5, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
CURVE_RATIOS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def law_parameters(slip: Slip) -> NDArray[np.float64]:
    """mu0_x, mu0_y, K_mu, a_x, a_y, K_x, K_y of a slip law, stiffness divided by its basis."""
    return np.array(
        [
            slip.longitudinal_friction,
            slip.lateral_friction,
            slip.friction_decrease,
            slip.longitudinal_shape,
            slip.lateral_shape,
            slip.longitudinal_stiffness,
            slip.lateral_stiffness,
        ]
    )


def normalized_forces(
    parameters: ArrayLike, slip_ratio: ArrayLike, slip_angle_rad: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Longitudinal and lateral friction over f_z, signed as in the figures, at slips that broadcast together.

    parameters (7,): as from `law_parameters`, with stiffness divided by f_z. NaN slips give NaN forces. Eqs. (4) to
    (7).
    """
    ratio, angle = np.broadcast_arrays(np.asarray(slip_ratio, float), np.asarray(slip_angle_rad, float))
    along, across = np.empty(ratio.size), np.empty(ratio.size)
    _fill(np.array(parameters, float), ratio.ravel(), angle.ravel(), along, across)
    return along.reshape(ratio.shape), across.reshape(ratio.shape)


def slip_curves(slip: Slip, angles_deg: Sequence[float] = BENCH_ANGLES_DEG, driving: bool = False) -> pd.DataFrame:
    """Data of Figures 3, 7, 8: rows of slip_ratio, slip_angle_deg, longitudinal, lateral (forces over f_z).

    First the curves of panel (a) at the slip angles angles_deg, then those of panel (b) at slip ratios from 0 to 1.
    Panel (a) starts at slip ratio 0 as in the figures; driving: at -1, to include driving slip.
    """
    import pandas as pd

    ratios = np.linspace(-1.0, 1.0, 201) if driving else SLIP_RATIOS
    ratio_a, angle_a = np.meshgrid(ratios, angles_deg)
    ratio_b, angle_b = np.meshgrid(CURVE_RATIOS, SLIP_ANGLES_DEG, indexing="ij")
    ratio = np.concatenate([ratio_a.ravel(), ratio_b.ravel()])
    angle = np.concatenate([angle_a.ravel(), angle_b.ravel()])
    along, across = normalized_forces(law_parameters(slip), ratio, np.radians(angle))
    panel = np.repeat(["a", "b"], [ratio_a.size, ratio_b.size])
    return pd.DataFrame(
        {"panel": panel, "slip_ratio": ratio, "slip_angle_deg": angle, "longitudinal": along, "lateral": across}
    )


@compiled()
def _fill(parameters: Any, ratio: Any, angle: Any, along: Any, across: Any) -> None:
    friction_x, friction_y, decrease, shape_x, shape_y, stiffness_x, stiffness_y = parameters
    for row in range(len(ratio)):
        force_x, force_y = wheel_force(
            np.cos(angle[row]),
            np.sin(angle[row]),
            ratio[row],
            friction_x,
            friction_y,
            stiffness_y / friction_x,
            stiffness_y / friction_y,
            stiffness_x / stiffness_y,
            shape_x,
            shape_y,
            decrease,
            0.0,
        )
        along[row], across[row] = -force_x, -force_y
