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
SMALL = [
    p for name in ("straight_speeds", "column_wheels") for p in sorted((SAMPLES / "recipes" / name).glob("*.toml"))
]
RUNS = [path for path in RECIPES if not path.stem.startswith("gauge")] + PUZZLE + SMALL
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
    for file in SAMPLES.rglob("experiment.toml"):
        for run in tomllib.loads(file.read_text(encoding="utf-8"))["run"]:
            said[(file.parent / run["video"]).resolve()] = (run["left_rpm"], run["right_rpm"], run["start_s"])
    assert said == commanded


@pytest.mark.parametrize("recipe", GAUGES[:2], ids=lambda path: path.stem)
def test_recipe_draws_the_committed_gauge_image(recipe: Path) -> None:
    scene = load_scene(recipe)
    assert isinstance(scene, GaugeScene)
    assert scene.truth is not None
    image, truth = render_gauge(scene)
    pd.testing.assert_frame_equal(truth, pd.read_csv(scene.truth), atol=1e-6, rtol=0)
    assert truth["visible"].all()
    stored = cv2.imread(str(scene.output))[..., ::-1]
    assert np.abs(stored.astype(int) - image).max() <= 1


@pytest.mark.parametrize("name", ["straight-60", "straight_speeds/60-backward", "column_wheels/turn-33-14"])
def test_recipe_draws_the_committed_clip(name: str) -> None:
    recipe = SAMPLES / "recipes" / f"{name}.toml"
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


def test_straight_speeds_of_the_clips_are_those_of_figure_17() -> None:
    commands = {(run["left_rpm"], run["right_rpm"]) for run in _runs("straight_speeds")}
    assert commands == {
        (sign * rpm, sign * rpm) for rpm in (3.0, 6.0, 15.0, 30.0, 45.0, 60.0, 90.0) for sign in (1, -1)
    }


def test_column_clips_have_the_column_robot() -> None:
    robots = [tomllib.loads(p.read_text(encoding="utf-8"))["robot"] for p in SMALL if p.parent.name == "column_wheels"]
    assert robots == ["column"] * 4
    assert len(_runs("column_wheels")) == 4


def _runs(folder: str) -> list[dict[str, float]]:
    file = SAMPLES / folder / "experiment.toml"
    return list(tomllib.loads(file.read_text(encoding="utf-8"))["run"])


def test_samples_stay_small() -> None:
    assert sum(path.stat().st_size for path in SAMPLES.rglob("*") if path.is_file()) < 10e6
