"""Speed that changes from run to run."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

LEAST_FACTOR = 0.01  # so that drift over a long session does not reverse the motors


def _act(draft: Draft, values: Values) -> None:
    draft.speed_factor *= max(1 + values["per_run"] * draft.run_index, LEAST_FACTOR)


EFFECT = Effect(
    id="speed-drift",
    name="speed changes from run to run",
    sentence="Both surface speeds change over a session by per_run from each run to the next; the first run counts 0.",
    law="v = (1 + per_run · k) · r·ω, k: number of the run from 0",
    source="Taylor series of a gain that drifts (battery, temperature, wear), cut after its linear term",
    limits="Runs count by their order in the file, not by the time between them. The speed is constant within a run, "
    "and never below 1 % of the nominal one.",
    kind="dynamics",
    parameters=(Parameter("per_run", "1/run", 0.0, 5e-4, -0.05, 0.05, shown=0.02),),
    act=_act,
    varies_by_run=True,
)
