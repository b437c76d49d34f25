from __future__ import annotations

import numpy as np
import pandas as pd

from evaluator.tracking import TrackingSettings, track
from tests.evaluator.tracking.synthetic import draw, frames_in_memory, turning_marks

SIZE, RADIUS, REST = (420, 220), 6.0, 15


def tracked(frames: int, still: int, settings: TrackingSettings | None = None) -> tuple[pd.DataFrame, np.ndarray]:
    """Two robots that look alike, the right one always at rest, the left one for some frames; truth of its green."""
    rng = np.random.default_rng(3)
    truth = turning_marks(frames, (100.0, 110.0), 24.0, 12.0, 0.03)
    lookalike = {name: points[0] + [210.0, 0.0] for name, points in truth.items()}
    images, green = [], []
    for k in range(frames):
        here = {name: points[max(k - still, 0)] for name, points in truth.items()}
        left = draw(rng, (SIZE[0] // 2, SIZE[1]), {n: tuple(p) for n, p in here.items()}, RADIUS, 0.8, 2.0)
        right = draw(rng, (SIZE[0] // 2, SIZE[1]), {n: tuple(p - [210.0, 0.0]) for n, p in lookalike.items()},
                     RADIUS, 0.8, 2.0)  # fmt: skip
        images.append(np.concatenate([left, right], axis=1).astype(float))
        green.append(here["green"])
    return track(frames_in_memory(images), settings), np.array(green)


def test_of_two_robots_at_rest_that_look_alike_the_one_that_moves_is_followed() -> None:
    table, green = tracked(60, REST)
    status = table["green_status"].to_numpy()
    assert (status[:REST] == "ambiguous").all()
    assert (status[REST + 16 :] == "ok").all()  # after a way of 1.5 radii
    error = table[["green_x_px", "green_y_px"]].to_numpy() - green
    assert np.nanmax(np.abs(error)) < 0.1


def test_while_none_of_two_robots_that_look_alike_moves_none_is_measured() -> None:
    table, _ = tracked(40, 40)
    for name in ("green", "yellow"):
        assert (table[f"{name}_status"] == "ambiguous").all()
        assert table[f"{name}_x_px"].isna().all()


def test_a_region_or_a_mask_tells_robots_that_look_alike_apart_at_once() -> None:
    for said in ({"region_px": [0, 0, 210, 220]}, {"mask_px": [[210, 0, 420, 220]]}):
        table, green = tracked(15, 15, TrackingSettings.model_validate(said))
        assert (table["green_status"] == "ok").all()
        assert np.abs(table[["green_x_px", "green_y_px"]].to_numpy() - green).max() < 0.1
