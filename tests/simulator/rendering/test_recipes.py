"""The committed samples are what their recipes make."""

from __future__ import annotations

import tomllib
from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd
import pytest

from simulator.rendering import GaugeScene, Scene, load_scene, render_gauge, set_stage, truth_of
from simulator.rendering.clip import frames_of
from simulator.rendering.tables import Simulated

SAMPLES = Path(__file__).parents[3] / "sample_videos"
RECIPES = sorted((SAMPLES / "recipes").glob("*.toml"))
PUZZLE = sorted((SAMPLES / "recipes" / "puzzle").glob("*.toml"))
RUNS = [path for path in RECIPES if not path.stem.startswith("gauge")] + PUZZLE
GAUGES = [path for path in RECIPES if path.stem.startswith("gauge")]


@pytest.mark.parametrize("recipe", RUNS, ids=lambda path: path.stem)
def test_recipe_moves_as_the_committed_truth(recipe: Path) -> None:
    scene = load_scene(recipe)
    assert isinstance(scene, Scene)
    assert scene.truth is not None
    committed = pd.read_csv(scene.truth)
    truth = truth_of(set_stage(scene))
    pd.testing.assert_frame_equal(truth, committed, atol=1e-3, rtol=0)
    assert (truth[["green_visible", "yellow_visible"]] == 1).all(axis=None)


def test_experiments_say_what_the_recipes_command_but_for_the_mess_of_the_puzzle() -> None:
    commanded = {}
    for recipe in RUNS:
        scene = load_scene(recipe)
        assert isinstance(scene, Scene)
        assert isinstance(scene.motion, Simulated)
        assert scene.output is not None
        motion = scene.motion
        started = pytest.approx(motion.start_s + (0.015 if recipe in PUZZLE else 0.0))  # the clock of the bench is off
        sides = (motion.left_rpm, motion.right_rpm)
        swapped = recipe.stem == "p05"  # whoever wrote the file confused left and right once
        commanded[scene.output.resolve()] = (*(sides[::-1] if swapped else sides), started)
    said = {}
    for file in (SAMPLES / "experiment.toml", SAMPLES / "puzzle" / "experiment.toml"):
        for run in tomllib.loads(file.read_text(encoding="utf-8"))["run"]:
            said[(file.parent / run["video"]).resolve()] = (run["left_rpm"], run["right_rpm"], run["start_s"])
    assert said == commanded


@pytest.mark.parametrize("recipe", GAUGES[:2], ids=lambda path: path.stem)
def test_recipe_draws_the_committed_gauge_picture(recipe: Path) -> None:
    scene = load_scene(recipe)
    assert isinstance(scene, GaugeScene)
    assert scene.truth is not None
    image, truth = render_gauge(scene)
    pd.testing.assert_frame_equal(truth, pd.read_csv(scene.truth), atol=1e-6, rtol=0)
    assert truth["visible"].all()
    stored = cv2.imread(str(scene.output))[..., ::-1]
    assert np.abs(stored.astype(int) - image).max() <= 1


def test_recipe_draws_the_committed_clip() -> None:
    recipe = SAMPLES / "recipes" / "straight-60.toml"
    scene = load_scene(recipe)
    assert isinstance(scene, Scene)
    stage = set_stage(scene)
    with av.open(str(scene.output)) as container:
        for frame, drawn in zip(container.decode(video=0), frames_of(stage), strict=False):
            assert frame.pts * frame.time_base == drawn.presentation_s
            difference = frame.to_ndarray(format="rgb24").astype(float) - drawn.image
            assert abs(difference.mean()) < 1.0
            assert difference.std() < 6.0  # compression takes most of the noise away
            if drawn.index == 60:
                break


def test_samples_stay_small() -> None:
    assert sum(path.stat().st_size for path in SAMPLES.rglob("*") if path.is_file()) < 10e6
