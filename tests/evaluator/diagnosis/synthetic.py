"""Small linear experiments whose likelihood is known as a dense Gaussian: the oracle of the mixed model."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from evaluator.diagnosis.inference.fitted_model import left_overs
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, Reduced, reduce_runs
from evaluator.diagnosis.likelihood.run_data import RunData

Floats = np.ndarray
FEATURES = 9


def linear_runs(count: int = 5, parameters: int = 2, seed: int = 1, scale: float = 3.0) -> list[Linearized]:
    """Runs of random linear physics, with noise of 1 and common parameters of about 1."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=parameters)
    found = []
    for _ in range(count):
        common, start = scale * rng.normal(size=(FEATURES, parameters)), rng.normal(size=(FEATURES, 3))
        scatter = 20 * rng.normal(size=(FEATURES, 4))
        own = np.array([0.05, 0.02, 0.02, 1.0]) * rng.normal(size=4)
        response = common @ theta + scatter @ own + start @ rng.normal(size=3) + rng.normal(size=FEATURES)
        found.append(Linearized(response, common, start, scatter))
    return found


def free_of_start(run: Linearized) -> tuple[Floats, Floats, Floats]:
    """Response, common and scatter columns in an orthonormal basis of what no start pose can make."""
    basis = np.linalg.qr(run.start, mode="complete")[0][:, 3:]
    return basis.T @ run.response, basis.T @ run.common, basis.T @ run.scatter


def minus_two_log(run: Linearized, theta: Floats, tau: Floats) -> float:
    """-2 log of the dense Gaussian density of a run at common parameters, without the constant of the dimension."""
    response, common, scatter = free_of_start(run)
    covariance = np.eye(len(response)) + scatter @ np.diag(tau**2) @ scatter.T
    left = response - common @ theta
    return float(left @ np.linalg.solve(covariance, left) + np.linalg.slogdet(covariance)[1])


def column(key: str, *, effect: bool = True, step: float = 1.0) -> Any:
    """A common parameter: a coordinate of an effect, or a nominal value."""
    term = SimpleNamespace(coordinates=(SimpleNamespace(step=step),)) if effect else None
    return SimpleNamespace(key=key, coordinate=0, term=term, prior_sigma=np.inf)


class _Standing(SimpleNamespace):
    """A fit without steps."""

    @property
    def misfits(self) -> tuple[Floats, Floats]:
        return left_overs(self.linearized, self.columns, np.array([self.point.value(item) for item in self.columns]))


def fit_of(
    runs: list[Linearized], columns: list[Any], theta: Floats, tau: Floats, covariance: Floats | None = None
) -> Any:
    """A fit that stands at these common parameters and this scatter."""
    values = {item.key: float(value) for item, value in zip(columns, theta, strict=True)}
    reduced: Reduced = reduce_runs(runs)
    return _Standing(
        columns=tuple(columns),
        point=SimpleNamespace(value=lambda item: values[item.key]),
        linearized=tuple(runs),
        reduced=reduced,
        posterior=SimpleNamespace(scatter=tau, covariance=covariance, mean=theta, log_evidence=0.0),
        runs=tuple(range(len(runs))),
    )


def run_data(left_rpm: float, right_rpm: float, order: int = 0, place: tuple[float, float] = (0.0, 0.0)) -> RunData:
    """A run of two frames of a robot at a place, marks 2 mm to either side, facing along x."""
    marks = np.tile([place[0], place[1] + 2.0, place[0], place[1] - 2.0], (2, 1))
    return RunData(f"r{order}", left_rpm, right_rpm, 0.0, None, np.array([0.0, 0.1]), marks, order)
