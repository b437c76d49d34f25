"""Friction that changes along the way of a run: what it does to a path, and how large it is in a session."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import simulator
from evaluator.diagnosis.likelihood.features import Compression, channel_residual, channels_of, compression
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.common_drift import common_drift
from evaluator.diagnosis.likelihood.noise.friction_wander import (
    RATES,
    shift_by,
    uneven_shifts,
    wander_shifts,
    whitening,
)
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, Noise
from evaluator.robot_geometry import wheel_sides
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


def test_modes_have_the_variance_of_a_walk_about_its_mean() -> None:
    """A straight run whose friction moved it ahead in proportion would show the walk itself in its speed."""
    base = np.column_stack([np.linspace(0, 30, 3001), np.zeros((3001, 3))])
    speeds = np.diff(wander_shifts(base, base, HALF_MM)[:, :, 0], axis=1) / np.diff(base[:, 0])
    assert np.sqrt(np.mean(np.sum(speeds**2, axis=0))) == pytest.approx(np.sqrt(30 / 6), rel=0.04)


def _sides(path: NDArray[np.complex128], track_mm: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    left = 1j * track_mm / 2 * np.gradient(path) / np.abs(np.gradient(path))
    return path + left, path - left


@pytest.mark.parametrize("track_mm", [4.0, 8.0])
def test_the_plate_differs_between_the_sides_as_its_friction_does_over_their_distance(track_mm: float) -> None:
    """A straight run that half of the difference moved ahead in proportion would show that difference in its speed."""
    base = np.column_stack([np.linspace(0, 20, 801), np.zeros((801, 3))])
    shifts = uneven_shifts(base, base, _sides(base[:, 0] + 0j, track_mm), HALF_MM)
    halves = np.diff(shifts[:, :, 0], axis=1) / np.diff(base[:, 0])
    covariance = halves.T @ halves
    assert np.sqrt(np.median(np.diag(covariance))) == pytest.approx(np.sqrt(track_mm) / 2, rel=0.1)
    # ten millimetres farther, what is left of it
    far = np.median(np.diag(covariance, 400))
    assert far == pytest.approx((np.hypot(10, track_mm) - 10) / 4, rel=0.15, abs=0.02)


def test_the_plate_under_a_robot_that_comes_back_is_the_same_again() -> None:
    turn = np.linspace(0, 4 * np.pi, 801)
    path = 3 * np.exp(1j * turn)
    ahead = np.column_stack([np.cumsum(np.full(len(turn), 0.01)), *np.zeros((3, len(turn)))])
    straight = np.column_stack([ahead[:, 0], *np.zeros((3, len(turn)))])
    halves = np.diff(uneven_shifts(straight, ahead, _sides(path, 4.0), HALF_MM)[:, :, 0], axis=1)
    np.testing.assert_allclose(halves[:, :380], halves[:, 400:780], atol=0.05 * np.abs(halves).max())


def test_sides_are_where_the_wheels_are() -> None:
    heading, centre = 0.7, 3.0 - 2.0j
    marks = [centre + np.exp(1j * heading) * complex(*place) for place in BARREL.points_mm.values()]
    row = np.array([[part for mark in marks for part in (mark.real, mark.imag)]])
    left, right = wheel_sides(BARREL, row)
    half = 0.5j * BARREL.track_mm * np.exp(1j * heading)
    assert left[0] == pytest.approx(centre + half)
    assert right[0] == pytest.approx(centre - half)


def test_whitening_undoes_the_covariance() -> None:
    columns = np.random.default_rng(1).normal(size=(8, 4))
    columns[:, 3] = 0.0
    found, covariance = whitening(columns), np.eye(8) + columns @ columns.T
    assert found.of(found.of(covariance).T) == pytest.approx(np.eye(8), abs=1e-12)
    assert found.undone(found.of(covariance)) == pytest.approx(covariance)
    assert found.log_det == pytest.approx(np.linalg.slogdet(covariance)[1])


def _session(seed: int, rate: float, drift_mm: float = 0.0) -> tuple[list[Linearized], list[Compression], list[Floats]]:
    """Views of twelve runs under white noise, friction that walks at a rate, and a camera that creeps."""
    rng = np.random.default_rng(seed)
    views, compressions, modes = [], [], []
    for command in COMMANDS * 3:
        base, throughout = _channels(BARREL, command), _per_friction(command)
        wander = wander_shifts(base, throughout, HALF_MM)
        residual = rng.normal(0, WHITE.white_mm, base.shape) + np.einsum("knc,k->nc", wander, rng.normal(0, rate, 10))
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
