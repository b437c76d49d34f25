"""What an effect is: a named piece of physics with parameters, added to a robot's draft or to the view of its marks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft
    from simulator.effects.view import View

Values = Mapping[str, float]
Where = Literal["command", "actuator", "wheel", "contact", "body force", "plate field", "observation"]
Depends = Literal["constant", "v", "v²", "sign v", "heading", "place", "time"]
Pattern = Literal["common", "left-right", "front-rear"]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    neutral: the value at which the effect is absent; low, high: plausible bounds for a fit; step: a small change that
    matters, for differences and scaling; at_least: values below make no sense.
    """

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    step: float
    at_least: float = float("-inf")


@dataclass(frozen=True)
class Effect:
    """A catalogued effect: id and plain name, its place in the grammar, its parameters, and how it acts.

    kind: "dynamics" and "command" act on the Draft of a robot; "observation" acts on the View of its marks.
    """

    id: str
    name: str
    kind: Literal["dynamics", "command", "observation"]
    where: Where
    depends: Depends
    pattern: Pattern
    parameters: tuple[Parameter, ...]
    act: Callable[[Draft, Values], None] | None = None
    view: Callable[[View, Values], None] | None = None

    def neutral(self) -> dict[str, float]:
        """Parameters at which the effect is absent."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}
