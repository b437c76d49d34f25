"""Definition of an effect: named physics with parameters, added to a robot's draft or to the view of its marks.

An effect is declared once, in its own file. Simulation, fit, report, catalogue page and command line read it there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.terms import Term
from simulator.effects.coordinates import Candidate, Scene, plain
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter
from simulator.effects.view import View

Values = Mapping[str, float]
Draws = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class SingleCause:
    """When an effect and another one, found together, are one cause that needs saying once.

    words: what that cause is, from draws of all parameters of both effects by name, (n,) each; "" where they are two.
    """

    other: str
    words: Callable[[Draws], str]


@dataclass(frozen=True)
class Effect:
    """A catalogued effect: what it is in words and in physics, its parameters, how it acts and how it is fitted.

    name: what is wrong, in a few words, for a verdict; sentence: what the effect does, with its parameters; law: its
    formula; source: where the law is from; limits: where it stops being true.
    kind: "dynamics" and "command" act on the Draft of a robot; "observation" acts on the View of its marks.
    varies_by_run: acts differently in each run of a session, by its number.
    of_plate: acts by the place or the direction of the robot on the plate, so that only runs in one frame can show it.
    of_ground: sought only in robots that drive on open ground: the few commands of runs on a plate cannot distinguish
    it from others.
    fitted: the coordinates of a fit; without it, the parameters themselves.
    sum_of: of an effect that is a sum of terms, each with the parameter that it is times; else empty.
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

    def absent(self) -> dict[str, float]:
        """Parameters at which the effect vanishes."""
        return {parameter.name: parameter.absent for parameter in self.parameters}

    def parameter(self, name: str) -> Parameter | None:
        """The parameter of a name; None where there is none."""
        return next((parameter for parameter in self.parameters if parameter.name == name), None)

    def candidate(self, scene: Scene) -> Candidate:
        """The effect in the coordinates in which it is fitted to the runs of a scene."""
        if self.fitted:
            return self.fitted(scene)
        return plain(self.id, tuple(parameter.sized(scene.size) for parameter in self.parameters))
