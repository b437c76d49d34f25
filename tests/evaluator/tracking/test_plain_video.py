"""Recordings as other laboratories make them, drawn without the product's renderer: at least as good as a threshold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.recording import open_recording
from evaluator.tracking import track
from tests.evaluator.tracking.plain_video import KINDS, SIZE, Clip, ellipse, pair
from tests.evaluator.tracking.scoring import Score, score, threshold_and_centroid


def measured(kind: str, folder: Path, seed: int = 1) -> tuple[Score, Score, pd.DataFrame, Clip]:
    clip = KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))
    path = clip.write(folder)
    table = track(open_recording(path), clip.settings)
    places = {name: table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float) for name in clip.truth}
    sigmas = {name: table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy(float) for name in clip.truth}
    return score(clip, places, sigmas), score(clip, threshold_and_centroid(path, clip)), table, clip


@pytest.mark.parametrize(
    "kind",
    [
        "discs, slanted 60 deg",
        "oblong stickers, two",
        "oblong sticker 3:1",
        "oblong, rough floor",
        "red roof, slanted",
        "oblong, things at rest",
    ],
)
def test_marks_of_any_shape_are_found_and_measured_at_least_as_well_as_by_a_threshold(
    tmp_path: Path, kind: str
) -> None:
    ours, simple, _, _ = measured(kind, tmp_path)
    assert ours.wrong == 0
    assert ours.found >= min(simple.found, 0.99)
    assert ours.scatter_px <= simple.scatter_px
    assert 0.3 < ours.normalised < 1.5


def test_marks_are_found_on_a_floor_of_all_colours(tmp_path: Path) -> None:
    ours, simple, _, _ = measured("discs, colourful floor", tmp_path)
    assert simple.found == 0.0
    assert ours.found == 1.0
    assert ours.wrong == 0
    assert 0.6 < ours.normalised < 1.5


def test_a_mark_that_the_border_cuts_at_first_is_followed_once_all_of_it_is_in_view(tmp_path: Path) -> None:
    clip = pair(
        np.random.default_rng(1), ellipse(14, 14), 7.0, 51.0, frames=40, step=-0.05, center=(SIZE[0] * 0.75, 120.0)
    )
    table = track(open_recording(clip.write(tmp_path)))
    whole = clip.truth["green"][:, 0] < SIZE[0] - 10
    assert (clip.truth["green"][:6, 0] > SIZE[0] - 10).all()
    assert (table.loc[whole, "green_status"] == "ok").all()


def test_a_mark_of_low_bitrate_has_an_uncertainty_that_holds(tmp_path: Path) -> None:
    ours, simple, _, _ = measured("oblong, low bitrate", tmp_path)
    assert ours.wrong == 0
    assert ours.scatter_px < simple.scatter_px
    assert 0.6 < ours.normalised < 1.6


def test_no_residue_of_a_codec_is_a_mark(tmp_path: Path) -> None:
    ours, simple, table, _ = measured("residue", tmp_path)
    assert simple.wrong > 20  # it shows a mark where there is none
    assert ours.wrong == 0
    assert ours.found == 1.0
    refused = table.loc[(table["green_status"] != "ok") | (table["yellow_status"] != "ok")]
    assert set(refused["green_status"]) | set(refused["yellow_status"]) <= {"ok", "off its course", "wrong distance"}


def test_things_at_rest_are_no_marks_of_what_moves_and_absent_marks_are_absent(tmp_path: Path) -> None:
    ours, simple, table, _ = measured("ball, yellow at rest", tmp_path)
    assert simple.wrong == 60
    assert ours.wrong == 0
    assert ours.found == 1.0
    assert set(table["yellow_status"]) <= {"not seen", "at rest while the robot moves"}
    assert (table["yellow_status"] == "at rest while the robot moves").any()


def test_outline_that_a_codec_drags_along_widens_the_uncertainty(tmp_path: Path) -> None:
    ours, _, _, _ = measured("green oblong, MPEG-4", tmp_path)
    assert ours.wrong == 0
    assert ours.found == 1.0
    assert 0.6 < ours.normalised < 1.8  # 2.1 from what single frames and the smoothness of the course say
