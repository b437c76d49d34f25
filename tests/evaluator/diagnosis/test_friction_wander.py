"""Friction that changes along the way of a run: what it does to a path, and how large it is in a session."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import simulator
from evaluator.diagnosis.likelihood.features import Compression, channel_residual, channels_of, compression
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.common_drift import common_drift
from evaluator.diagnosis.likelihood.noise.friction_wander import (
    MODES,
    RATES,
    shift_by,
    wander_shifts,
    whitening,
)
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, Noise
from evaluator.robot_geometry import wheel_paths
from simulator.robot import EffectEntry, Robot

Floats = NDArray[np.float64]

TIME_S = np.arange(300) / 60
HALF_MM = 1.83
WHITE = Noise(0.003, 0.0, 1 / 60)
COMMANDS = [(60.0, 40.0), (-33.3, -14.4), (14.4, 33.3), (40.0, 60.0)]
BARREL = simulator.load_robot("barrel")


def _channels(robot: Robot, command: tuple[float, float]) -> Floats:
    run = simulator.simulate(robot, simulator.Command.constant(*command, start_s=0.2), TIME_S)
    marks = simulator.marks_of_run(robot, run)
    return channels_of(marks[["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]].to_numpy())


def _with(effect: str, **values: float) -> Robot:
    return BARREL.model_copy(update={"effect": (EffectEntry(id=effect, **values),)})


def _per_friction(command: tuple[float, float]) -> Floats:
    more = _channels(_with("friction-level", factor=1.001), command)
    return channel_residual(more, _channels(BARREL, command), HALF_MM) / 1e-3


@pytest.mark.parametrize("command", COMMANDS)
def test_run_that_comes_onto_another_friction_goes_on_as_one_that_always_had_it(command: tuple[float, float]) -> None:
    change, at = 2e-3, 140
    base, slippery = _channels(BARREL, command), _channels(_with("friction-level", factor=1 + change), command)
    turn = base[at, 2] - slippery[at, 2]
    middles = [part[:, 0] + 1j * part[:, 1] for part in (base, slippery)]
    later = middles[0][at] + np.exp(1j * turn) * (middles[1][at:] - middles[1][at])
    expected = base.copy()
    expected[at:, :3] = np.column_stack([later.real, later.imag, slippery[at:, 2] + turn])
    there = channel_residual(expected, base, HALF_MM)
    friction = change * (np.arange(len(TIME_S) - 1) >= at)
    told = shift_by(friction, base, _per_friction(command), HALF_MM)
    assert np.abs(told - there)[:, :3].max() < 0.02 * np.abs(there).max()


def test_modes_of_a_single_wheel_have_the_variance_of_a_walk_about_its_mean() -> None:
    """A straight run whose friction moved it ahead in proportion would show the walk itself in its speed."""
    base = np.column_stack([np.linspace(0, 30, 3001), np.zeros((3001, 3))])
    shifts = wander_shifts(base, [base], base[None, :, 0] + 0j, HALF_MM)
    speeds = np.diff(shifts[:, :, 0], axis=1) / np.diff(base[:, 0])
    assert np.sqrt(np.mean(np.sum(speeds**2, axis=0))) == pytest.approx(np.sqrt(30 / 6), rel=0.04)


def _differences(path: NDArray[np.complex128], wheels_mm: NDArray[np.complex128], signs: Sequence[float]) -> Floats:
    """Speeds (MODES, n - 1) of a straight run that half of a difference of friction moves ahead in proportion."""
    straight = np.column_stack([np.linspace(0, 20, len(path)), *np.zeros((3, len(path)))])
    shifts = wander_shifts(straight, [sign / 2 * straight for sign in signs], wheels_mm, HALF_MM)
    return np.asarray(np.diff(shifts[:, :, 0], axis=1) / np.diff(straight[:, 0]))


@pytest.mark.parametrize("across", [True, False])
@pytest.mark.parametrize("apart_mm", [4.0, 8.0])
def test_friction_differs_between_wheels_by_their_distance(apart_mm: float, across: bool) -> None:
    path = np.linspace(0, 20, 801) + 0j
    away = (0.5j if across else 0.5) * apart_mm
    speeds = _differences(path, np.array([path + away, path - away]), (1.0, -1.0))
    covariance = speeds.T @ speeds
    assert np.sqrt(np.median(np.diag(covariance))) == pytest.approx(np.sqrt(apart_mm) / 2, rel=0.1)
    # ten millimetres farther, what is left of it: the variogram of the surface is the distance
    ahead, behind = (10.0, 10.0) if across else (10 + apart_mm, 10 - apart_mm)
    diagonal = np.hypot(10, apart_mm) if across else 0.0
    left = (diagonal - 10) / 4 if across else (ahead + behind - 20) / 8
    assert np.median(np.diag(covariance, 400)) == pytest.approx(left, rel=0.15, abs=0.05)


def test_the_plate_under_a_robot_that_comes_back_is_the_same_again() -> None:
    path = 3 * np.exp(1j * np.linspace(0, 4 * np.pi, 801))
    left = 2j * np.gradient(path) / np.abs(np.gradient(path))
    speeds = _differences(path, np.array([path + left, path - left]), (1.0, -1.0))
    np.testing.assert_allclose(speeds[:, :380], speeds[:, 400:780], atol=0.1 * np.abs(speeds).max())


def test_wheels_are_where_the_robot_has_them() -> None:
    heading, centre = 0.7, 3.0 - 2.0j
    marks = [centre + np.exp(1j * heading) * complex(*place) for place in BARREL.points_mm.values()]
    row = np.array([[part for mark in marks for part in (mark.real, mark.imag)]])
    expected = [centre + np.exp(1j * heading) * complex(*place) for place in BARREL.wheel_positions_mm()]
    np.testing.assert_allclose(wheel_paths(BARREL, row)[:, 0], expected)


def test_whitening_undoes_the_covariance() -> None:
    columns = np.random.default_rng(1).normal(size=(8, 4))
    columns[:, 3] = 0.0
    found, covariance = whitening(columns), np.eye(8) + columns @ columns.T
    assert found.of(found.of(covariance).T) == pytest.approx(np.eye(8), abs=1e-12)
    assert found.undone(found.of(covariance)) == pytest.approx(covariance)
    assert found.log_det == pytest.approx(np.linalg.slogdet(covariance)[1])


@cache
def _path(command: tuple[float, float]) -> tuple[Floats, Floats, Floats]:
    """Channels of a run, their response to another friction throughout, and to each mode of one that walks."""
    base, throughout = _channels(BARREL, command), _per_friction(command)
    return base, throughout, wander_shifts(base, [throughout], base[None, :, 0] + 1j * base[None, :, 1], HALF_MM)


def _session(seed: int, rate: float, drift_mm: float = 0.0) -> tuple[list[Linearized], list[Compression], list[Floats]]:
    """Views of twelve runs under white noise, friction that walks at a rate, and a camera that creeps."""
    rng = np.random.default_rng(seed)
    views, compressions, modes = [], [], []
    for command in COMMANDS * 3:
        base, throughout, wander = _path(command)
        walk = np.einsum("knc,k->nc", wander, rng.normal(0, rate, MODES))
        residual = rng.normal(0, WHITE.white_mm, base.shape) + walk
        residual[:, :2] += rng.normal(0, drift_mm, 2) * TIME_S[:, None]
        made = compression(TIME_S, np.ones(len(TIME_S), dtype=bool), (WHITE,) * 4)
        start = np.zeros((3, *base.shape))
        start[0, :, 0] = start[1, :, 1] = 1.0
        start[2, :, :3] = np.column_stack([-base[:, 1], base[:, 0], np.full(len(base), HALF_MM)])
        response, scatter = made.features(residual), np.zeros((len(made.features(residual)), 4))
        scatter[:, 0] = made.features(throughout)
        views.append(Linearized(response, np.zeros((len(response), 1)), made.features(start).T, scatter))
        compressions.append(made)
        modes.append(made.of_tracking(wander).T)
    return views, compressions, modes


def _found(seed: int, rate: float, drift_mm: float = 0.0) -> tuple[Drift, float]:
    views, compressions, modes = _session(seed, rate, drift_mm)
    found = common_drift(views, compressions, [TIME_S] * len(views), np.array([0.0]), NO_DRIFT, modes)
    return found.drift, found.wander


@pytest.mark.parametrize("seed", range(2))
def test_wander_is_found_and_is_no_drift(seed: int) -> None:
    drift, rate = _found(seed, 5e-3)
    assert drift == NO_DRIFT
    assert rate == pytest.approx(5e-3, rel=0.8)


def test_neither_noise_nor_a_camera_that_creeps_is_friction() -> None:
    assert _found(3, 0.0) == (NO_DRIFT, 0.0)
    drift, rate = _found(4, 0.0, drift_mm=0.004)
    assert rate == 0.0
    assert drift != NO_DRIFT


def test_both_are_told_apart() -> None:
    drift, rate = _found(5, RATES[6], drift_mm=0.006)
    assert drift.creep_mm_s > 0.002
    assert rate == pytest.approx(RATES[6], rel=0.8)
