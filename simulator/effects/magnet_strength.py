"""Magnets that are stronger or weaker than stated."""

from __future__ import annotations

from math import exp, log

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

DRIVING = Parameter("driving_factor", "", 1.0, 0.02, 0.05, 5.0, at_least=0.0, shown=1.0)
DRIVEN = Parameter("driven_factor", "", 1.0, 0.02, 0.0, 100.0, at_least=0.0, shown=6.0)

# Of the logarithm of the level: from 0.14 to 7 times the stated one within two standard deviations.
LEVEL_SIGMA = 1.0

LOAD_RATIO = "driven_over_driving_load"


def _act(draft: Draft, values: Values) -> None:
    draft.attraction_factor[draft.layout.driving] *= values["driving_factor"]
    draft.attraction_factor[~draft.layout.driving] *= values.get("driven_factor", DRIVEN.absent)


def _fitted(scene: Scene) -> Candidate:
    """Coordinates: balance of the axles, and the logarithm of the level.

    With a slip law that scales with the load, motion depends on the balance of the loads, which are attraction and
    weight, and on the level only through weight and inertia relative to it. Beside a balance, most runs do not show the
    level: it then stays near the stated one, and what the runs determine is the ratio of the loads. Without magnets in
    driven wheels there is no balance, and the inverse level is what acts.
    """
    driving, driven = scene.attraction
    stated = (1 + driven) / (1 + driving)

    def physical(values: tuple[float, ...]) -> Parameters:
        share = values[0] * stated
        # the plate attracts driven wheels at least by nothing: their load is at least their weight
        level = max(exp(values[1]), (1 / share - 1) / driving if driving else 0.0)
        return {"driving_factor": level, "driven_factor": max(share * (1 + driving * level) - 1, 0.0) / driven}

    def known(values: tuple[float, ...]) -> Parameters:
        return {LOAD_RATIO: values[0] * stated}

    if not driven:
        weakness = Coordinate("weakness", 1.0, DRIVING.step, 1 / DRIVING.high, 1 / DRIVING.low)
        return Candidate("magnet-strength", (weakness,), lambda values: {"driving_factor": 1.0 / values[0]})
    least, most = ((1 + driven * factor) / (stated * (1 + driving * DRIVING.high)) for factor in (0.0, DRIVEN.high))
    level = Coordinate("log_level", 0.0, DRIVING.step, log(DRIVING.low), log(DRIVING.high), prior_sigma=LEVEL_SIGMA)
    balance = Coordinate("load_balance", 1.0, DRIVEN.step, least, most, closed=True)
    return Candidate("magnet-strength", (balance, level), physical, known=known)


EFFECT = Effect(
    id="magnet-strength",
    name="magnets are stronger or weaker than stated",
    sentence="The driving wheels are attracted driving_factor times as strongly as stated, the driven wheels "
    "driven_factor times.",
    law="A_driving = driving_factor · A_driving,stated and A_driven = driven_factor · A_driven,stated",
    source="balance of forces: the load of a wheel is its weight share plus its attraction",
    limits="The attraction is constant over place and time: a plate of even thickness and permeability.",
    kind="dynamics",
    parameters=(DRIVING, DRIVEN),
    act=_act,
    fitted=_fitted,
)
