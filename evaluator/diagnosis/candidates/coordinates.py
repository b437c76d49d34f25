"""Every effect of the catalogue in the coordinates in which it is fitted to the runs at hand."""

from __future__ import annotations

from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Scene


def named_terms(reach_mm: float, command_levels_rpm: tuple[float, ...]) -> dict[str, Candidate]:
    """All effects as candidates, by id.

    reach_mm: how far from the origin the robot moved, for the places an attraction may sit. command_levels_rpm: the
    different |rpm| that were commanded; a dead band can only lie between them.
    """
    scene = Scene(reach_mm, command_levels_rpm)
    return {effect.id: effect.candidate(scene) for effect in EFFECTS.values()}
