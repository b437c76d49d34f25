"""What the solutions of normal equations explain, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.linear.normal_equations import explained, normal_matrices, solved


def equations(size: int = 5, count: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrices (count, size, size) and right-hand sides of columns in units of ten powers apart."""
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(count, 40, size)) * 10.0 ** np.arange(-2, size - 2)
    return columns.transpose(0, 2, 1) @ columns, np.einsum("tdk,td->tk", columns, rng.normal(size=(count, 40)))


@pytest.mark.parametrize(
    "known",
    [(True, True, False, False, False), (False, True, False, True, False), (False,) * 5, (True,) * 5],
)
def test_one_elimination_gives_the_gain_of_all_columns_and_the_determinant_of_the_known(
    known: tuple[bool, ...],
) -> None:
    H, right = equations()
    gain, log_det = explained(H, right, np.array(known))
    where = np.flatnonzero(known)
    for t in range(len(H)):
        assert gain[t] == pytest.approx(right[t] @ np.linalg.solve(H[t], right[t]), rel=1e-9)
        assert log_det[t] == pytest.approx(np.linalg.slogdet(H[t][np.ix_(where, where)])[1], abs=1e-9)


def test_no_columns_explain_nothing() -> None:
    gain, log_det = explained(np.zeros((2, 0, 0)), np.zeros((2, 0)), np.zeros(0, dtype=bool))
    assert gain.tolist() == log_det.tolist() == [0.0, 0.0]


def test_columns_that_say_the_same_share_what_they_explain() -> None:
    H, right = equations(2)
    one, _ = explained(H[:, 1:, 1:], right[:, 1:], np.array([False]))
    same = normal_matrices(H[:, [1, 1]][:, :, [1, 1]], np.zeros(2))
    both, _ = explained(same, right[:, [1, 1]], np.array([False, False]))
    assert both == pytest.approx(one, rel=1e-6)
    assert solved(same, right[:, [1, 1], None]).sum(axis=1)[:, 0] == pytest.approx(right[:, 1] / H[:, 1, 1], rel=1e-6)
