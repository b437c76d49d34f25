from __future__ import annotations

import numpy as np
import pytest

from evaluator.tracking.refinement.disc import make_disc
from evaluator.tracking.refinement.shading import learn_shading

DISC = make_disc(8.0, 0.9, (0.0, 0.0), (120.0, 40.0), 1.0)


@pytest.mark.parametrize("covered", [0.0, 0.2])
def test_uneven_light_is_learnt_though_a_wire_passes_over_the_mark(covered: float) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(100, 400, (200, 2))
    beta = np.array([4e-4, -2e-4]) + 2e-6 * (places - 250.0)
    measured = beta + rng.normal(0, 5e-4, beta.shape)
    measured[rng.random(200) < covered] += [0.03, -0.02]
    shading = learn_shading(DISC, 16.0, places, measured * (160.0 - 16.0))
    assert shading is not None
    shift, variance = shading.shift(places)
    normal = (shift - shading.gain * beta) / np.sqrt(variance)[:, None]
    assert np.sqrt(np.mean(normal**2)) < 2.0
