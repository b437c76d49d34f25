"""Definition of an effect: named physics with parameters, which acts on a robot's draft or on the view of its marks.

An effect is declared once, in its own file. Simulation, fit, report, catalogue page and command line read it there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.scale import USUAL_DISTANCE_MM
from simulator.dynamics.terms import Term
from simulator.effects.coordinates import Candidate, Scene, plain
from simulator.effects.draft import Draft
from simulator.effects.parameter import ON_PLATE, Parameter
from simulator.effects.view import View

SOUGHT_ON_GROUND = (
    "A diagnosis seeks it last for robots whose wheels are on average less than "
    f"{ON_PLATE * USUAL_DISTANCE_MM:.0f} mm from their middle: instead of effects that it has found, or if none "
    "explains the runs."
)

Values = Mapping[str, float]
Draws = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class SingleCause:
    """Test whether this effect and another one, found together, have a single cause, which is then reported instead.

    words: name of that cause, from posterior draws of all parameters of both effects by name, (n,) each; "" if the
    causes are separate.
    """

    other: str
    words: Callable[[Draws], str]


@dataclass(frozen=True)
class Effect:
    """An effect of the catalogue: its description, its physics, its parameters, and how it is fitted.

    name: what is wrong, in a few words, for a verdict; sentence: what the effect does, with its parameters; law: its
    formula; source: reference of the law; limits: of its validity.
    kind: "dynamics" and "command" act on the Draft of a robot; "observation" acts on the View of its marks.
    varies_by_run: depends on the number of the run in the session.
    of_plate: depends on the robot's position or direction on the plate; only runs in a common frame can show it.
    of_ground: of robots too large for a plate; for others it is sought last, because the few commands of runs on a
    plate hardly distinguish it from other effects.
    fitted: gives the coordinates of a fit; default: the parameters themselves.
    sum_of: for an effect that is a sum of terms, each term with the name of the parameter that multiplies it.
    """

    id: str
    name: str
    sentence: str
    law: str
    source: str
    limits: str
    kind: Literal["dynamics", "command", "observation"]
    parameters: tuple[Parameter, ...]
    act: Callable[[Draft, Values], None] | None = None
    view: Callable[[View, Values], None] | None = None
    varies_by_run: bool = False
    of_plate: bool = False
    of_ground: bool = False
    fitted: Callable[[Scene], Candidate] | None = None
    single_cause: SingleCause | None = None
    sum_of: tuple[tuple[str, Term], ...] = ()

    @property
    def where_valid(self) -> str:
        """Limits of its validity, and of a diagnosis, in sentences."""
        return f"{self.limits} {SOUGHT_ON_GROUND}" if self.of_ground else self.limits

    def absent(self) -> dict[str, float]:
        """Parameters at which the effect vanishes."""
        return {parameter.name: parameter.absent for parameter in self.parameters}

    def parameter(self, name: str) -> Parameter | None:
        """The parameter with a name; None if there is none."""
        return next((parameter for parameter in self.parameters if parameter.name == name), None)

    def candidate(self, scene: Scene) -> Candidate:
        """The effect in the coordinates in which it is fitted to the runs of a scene."""
        if self.fitted:
            return self.fitted(scene)
        return plain(self.id, tuple(parameter.sized(scene.size) for parameter in self.parameters))
