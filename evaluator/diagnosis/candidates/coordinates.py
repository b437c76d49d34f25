"""Every effect of the catalogue in the coordinates in which it is fitted to the runs at hand."""

from __future__ import annotations

from collections.abc import Sequence

from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Scene
from simulator.own_effects.files import BUILT_IN


def named_terms(
    reach_mm: float, command_levels_rpm: tuple[float, ...], own: Sequence[str] = ()
) -> dict[str, Candidate]:
    """All effects of the catalogue as candidates, by id, and those of the user's own.

    reach_mm: how far from the origin the robot moved, for the places an attraction may sit. command_levels_rpm: the
    different |rpm| that were commanded; a dead band can only lie between them.
    """
    scene = Scene(reach_mm, command_levels_rpm)
    ids = [*(effect for effect in EFFECTS if effect in BUILT_IN), *own]
    return {effect: EFFECTS[effect].candidate(scene) for effect in ids}
