"""All effects by id. A new effect is its file and its line here."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from simulator.effects import (
    axle_compliance,
    camera_tilt,
    command_lag,
    dead_band,
    drive_speed_mismatch,
    drive_speed_scale,
    free_form,
    friction_gradient,
    friction_grain,
    friction_level,
    magnet_imbalance,
    magnet_strength,
    mark_offset,
    mass_offset,
    motor_droop,
    plane_scale,
    plate_tilt,
    rolling_drag,
    scrub_torque,
    speed_drift,
    speed_ripple,
    stray_magnet,
    tether_pull,
    tether_spring,
    time_base,
    viscous_drag,
    wheel_toe,
)
from simulator.effects.definition import Effect
from simulator.effects.view import View
from simulator.errors import SimulationError

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft
    from simulator.robot import Effect as Entry
    from simulator.robot import Robot

EFFECTS: dict[str, Effect] = {
    module.EFFECT.id: module.EFFECT
    for module in (
        drive_speed_mismatch,
        drive_speed_scale,
        motor_droop,
        command_lag,
        speed_ripple,
        dead_band,
        speed_drift,
        magnet_imbalance,
        magnet_strength,
        friction_level,
        wheel_toe,
        rolling_drag,
        scrub_torque,
        axle_compliance,
        mass_offset,
        plate_tilt,
        tether_pull,
        tether_spring,
        viscous_drag,
        friction_gradient,
        friction_grain,
        stray_magnet,
        mark_offset,
        plane_scale,
        time_base,
        camera_tilt,
    )
}


def effect_values(entry: Entry) -> dict[str, float]:
    """Parameters of one [[effect]]; those not given are neutral. The entry must be free of faults."""
    return EFFECTS[entry.id].neutral() | {name: float(value) for name, value in (entry.model_extra or {}).items()}


def faults_of_effects(entries: Sequence[Entry]) -> list[str]:
    """What is wrong with the [[effect]] entries of a robot, a phrase each."""
    faults = [fault for entry in entries for fault in _faults(entry)]
    ids = [entry.id for entry in entries if entry.id != free_form.ID]
    return faults + [f"effect {id_} stands twice" for id_ in sorted(set(ids)) if ids.count(id_) > 1]


def apply_effects(draft: Draft) -> None:
    """Let the effects of the draft's robot act on it. Raises SimulationError for faulty entries."""
    entries = draft.robot.effect
    faults = faults_of_effects(entries)
    if faults:
        raise SimulationError(f"{draft.robot.name}: {'; '.join(faults)}")
    for entry in entries:
        if entry.id == free_form.ID:
            term = free_form.term_of(entry.model_extra or {})
            if not term.is_seen_only:
                draft.add(term)
            continue
        act = EFFECTS[entry.id].act
        if act:
            act(draft, effect_values(entry))


def view_of(robot: Robot) -> View:
    """How the robot's marks are seen, with its observation effects."""
    view = View(robot.marks.green_mm, robot.marks.yellow_mm)
    for entry in robot.effect:
        if entry.id == free_form.ID:
            term = free_form.term_of(entry.model_extra or {})
            view.errors += (term,) if term.is_seen_only else ()
        see = EFFECTS[entry.id].view if entry.id in EFFECTS else None
        if see:
            see(view, effect_values(entry))
    return view


def _faults(entry: Entry) -> Iterator[str]:
    given = entry.model_extra or {}
    if entry.id == free_form.ID:
        yield from free_form.faults(given)
        return
    if entry.id not in EFFECTS:
        near = difflib.get_close_matches(entry.id, [*EFFECTS, free_form.ID], n=1, cutoff=0.4)
        yield f"unknown effect {entry.id}" + (f"; did you mean {near[0]}?" if near else "")
        return
    parameters = {parameter.name: parameter for parameter in EFFECTS[entry.id].parameters}
    if not given:
        yield f"effect {entry.id} has no parameters; it takes {', '.join(parameters)}"
    for name, value in given.items():
        if name not in parameters:
            near = difflib.get_close_matches(name, parameters, n=1, cutoff=0.4)
            hint = f"; did you mean {near[0]}?" if near else f"; it takes {', '.join(parameters)}"
            yield f"effect {entry.id} has no parameter {name}{hint}"
        elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            yield f"effect {entry.id}: {name} = {value!r} is not a finite number"
        elif value < parameters[name].at_least:
            yield f"effect {entry.id}: {name} = {value:g} must be at least {parameters[name].at_least:g}"
