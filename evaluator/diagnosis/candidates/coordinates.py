"""Every effect of the catalogue in the coordinates in which it is fitted to the runs at hand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from simulator.dynamics.layout import Layout
from simulator.dynamics.scale import USUAL_DISTANCE_MM, time_unit_s
from simulator.dynamics.terms import UN_PER_MN
from simulator.effects.catalogue import BUILT_IN, EFFECTS
from simulator.effects.coordinates import PAPER_ATTRACTION, Candidate, Scene
from simulator.effects.parameter import PAPER_SIZE, Size
from simulator.robot import Robot

if TYPE_CHECKING:
    from evaluator.diagnosis.likelihood.run_data import RunData

USUAL_LOAD_MN = 53.9  # load on the wheels of the paper's barrel robot: weight 4.9 mN, attraction 49 mN


def size_of(robot: Robot, *, filmed: bool = False) -> Size:
    """Size of a robot relative to the paper's; PAPER_SIZE for robots with the same units of the kernels.

    filmed: whether a fixed camera sees its marks.
    """
    places = robot.wheel_positions_mm()
    if time_unit_s(places) == 1.0:
        return PAPER_SIZE
    off = places - places.mean(axis=0)
    load_mN = robot.weight_uN / UN_PER_MN + sum(wheel.attraction_mN for wheel in robot.all_wheels)
    return Size(float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) / USUAL_DISTANCE_MM, load_mN / USUAL_LOAD_MN, filmed)


def attraction_of(robot: Robot) -> tuple[float, float]:
    """Attraction of a wheel with and of one without a motor, means, over the weight on a wheel; 0 without such."""
    layout = Layout.of(robot)
    weight = robot.weight_uN / len(layout.driving)
    kinds = (layout.attraction_uN[layout.driving], layout.attraction_uN[~layout.driving])
    driving, driven = (float(kind.mean()) / weight if kind.size else 0.0 for kind in kinds)
    return driving, driven


def is_full_size(robot: Robot) -> bool:
    """Whether a robot is too large for a plate."""
    return size_of(robot).full


def on_open_ground(robots: Iterable[Robot], data: Iterable[RunData]) -> bool:
    """Whether runs are of a robot too large for a plate, whose poses are not from the marks that a fixed camera sees.

    Ground on which a robot is filmed is a floor, of which a laboratory knows as much as of a plate: as open ground, a
    robot of 0.2 m whose runs scatter by 0.15 % in speed was said to have a grain of friction of 0.09 %. Each robot is
    asked once, though thousands of runs share it.
    """
    known = {id(robot): robot for robot in robots}.values()
    return any(run.from_poses for run in data) and any(map(is_full_size, known))


def named_terms(
    reach_mm: float,
    command_levels_rpm: tuple[float, ...],
    own: Sequence[str] = (),
    size: Size = PAPER_SIZE,
    *,
    one_frame: bool = True,
    commands_recur: bool = True,
    of_ground: bool = False,
    attraction: tuple[float, float] = PAPER_ATTRACTION,
    passed_rpm: tuple[float, ...] = (),
) -> dict[str, Candidate]:
    """All effects of the catalogue, and those of the user, as candidates by id.

    reach_mm: largest distance of the robot from the origin, for positions of an attraction. command_levels_rpm:
    distinct values of commanded |rpm|, between which a dead band may lie. size: of the robot; steps and bounds of
    effects of the user are not scaled. one_frame: whether the runs share a frame; without it, effects of the plate are
    omitted. commands_recur: whether commands are driven again later; without it, effects that vary from run to run are
    omitted. attraction, passed_rpm: see Scene. of_ground: whether to give a small robot the effects of large ones, too.
    """
    scene = Scene(reach_mm, command_levels_rpm, size, attraction, passed_rpm)
    as_stated = replace(scene, size=PAPER_SIZE)
    scenes = dict.fromkeys(BUILT_IN, scene) | dict.fromkeys(own, as_stated)
    left_out = {id_ for id_ in scenes if EFFECTS[id_].of_plate and not one_frame}
    left_out |= {id_ for id_ in scenes if EFFECTS[id_].varies_by_run and not commands_recur}
    left_out |= {id_ for id_ in scenes if EFFECTS[id_].of_ground and not (size.full or of_ground)}
    return {id_: EFFECTS[id_].candidate(its) for id_, its in scenes.items() if id_ not in left_out}
