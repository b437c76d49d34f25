"""Effects act beside each other: in any order, and as if an absent one were not there."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.dynamics.model import MOST_TERMS, NUMBERS, compile_robot, record_of
from simulator.effects.catalogue import EFFECTS
from simulator.effects.draft import Draft
from simulator.effects.entry import EffectEntry
from simulator.effects.view import View
from simulator.observation import view_of
from simulator.robot import Robot, load_robot

BARREL = load_robot("barrel")
RUN_INDEX = 3
PAIRS = list(combinations(sorted(EFFECTS), 2))
# No two effects of the catalogue depend on their order: they multiply factors, add up offsets and terms, or wait for
# all others where they need the loads or the centre of gravity that these leave. An exception would be named here.
ORDER_MATTERS: frozenset[tuple[str, str]] = frozenset()
SETTINGS = settings(max_examples=4, deadline=None, derandomize=True)
FLAGS = ("general", "wheels_vary_with_velocity", "body_varies_with_velocity", "varies", "wheels_vary")
POSES = np.array([[3.0, -2.0, 0.7], [-20.0, 5.0, 2.0]]).T


@st.composite
def sizes(draw: st.DrawFn, effect_id: str) -> EffectEntry:
    """An entry with every parameter up to 10 steps away from absent, on the side where it makes sense."""
    values = {}
    for item in EFFECTS[effect_id].parameters:
        low = 0.0 if item.absent - 10 * item.step < item.at_least else -10.0
        values[item.name] = item.absent + draw(st.floats(low, 10.0, allow_nan=False)) * item.step
    return EffectEntry.model_validate({"id": effect_id, **values})


EVERY = st.fixed_dictionaries({effect_id: sizes(effect_id) for effect_id in sorted(EFFECTS)})


def with_effects(*entries: EffectEntry) -> Robot:
    return BARREL.model_copy(update={"effect": entries})


def contents(record: np.ndarray) -> np.ndarray:
    """All that a record holds; its terms in an order of their own, as they are summed up."""
    row = np.asarray(record)[0]
    count = row["body_terms"] + row["wheel_terms"]
    names = ("channel", "basis", "coefficient", "point_x", "point_y", "falloff", "pattern")
    terms = np.column_stack([np.reshape(row[name], (MOST_TERMS, -1))[:count] for name in names])
    terms = terms[np.lexsort(np.round(terms, 9).T)]
    flags = [row[name] for name in ("body_terms", "wheel_terms", *FLAGS)]
    return np.concatenate([*(np.ravel(row[name]) for name in NUMBERS), terms.ravel(), flags])


@given(EVERY)
@SETTINGS
def test_a_robot_with_two_effects_is_one_on_which_both_acted_in_either_order(every: dict[str, EffectEntry]) -> None:
    for one, other in PAIRS:
        if (one, other) in ORDER_MATTERS:
            continue
        pair = every[one], every[other]
        compiled, expected = contents(compile_robot(with_effects(*pair), RUN_INDEX)), view_of(with_effects(*pair))
        seen = expected.marks(*POSES)
        for order in (pair, pair[::-1]):
            record, view = acted(order)
            found = contents(record)
            assert found.shape == compiled.shape, (one, other)
            assert np.allclose(found, compiled, rtol=1e-12), (one, other)
            assert np.allclose(view.marks(*POSES), seen, rtol=1e-12), (one, other)
            assert view.time_factor == expected.time_factor


@given(EVERY)
@SETTINGS
def test_an_absent_effect_changes_nothing_beside_another(every: dict[str, EffectEntry]) -> None:
    for present, entry in every.items():
        record, view = compile_robot(with_effects(entry), RUN_INDEX).tobytes(), view_of(with_effects(entry))
        for absent in sorted(EFFECTS.keys() - {present}):
            nothing = EffectEntry.model_validate({"id": absent, **EFFECTS[absent].absent()})
            beside = with_effects(entry, nothing)
            assert compile_robot(beside, RUN_INDEX).tobytes() == record, (present, absent)
            assert view_of(beside) == view


def acted(entries: tuple[EffectEntry, ...]) -> tuple[np.ndarray, View]:
    """The record and the view that effects leave which act one after the other."""
    draft, view = Draft(BARREL, RUN_INDEX), view_of(BARREL)
    for entry in entries:
        effect = EFFECTS[entry.id]
        if effect.act:
            effect.act(draft, entry.given)
        if effect.view:
            effect.view(view, entry.given)
    return record_of(draft), view


@pytest.mark.parametrize("effect_id", sorted(EFFECTS))
def test_an_effect_says_whether_it_varies_from_run_to_run(effect_id: str) -> None:
    values = {item.name: item.absent + item.step for item in EFFECTS[effect_id].parameters}
    robot = with_effects(EffectEntry.model_validate({"id": effect_id, **values}))
    varies = compile_robot(robot, 0).tobytes() != compile_robot(robot, 7).tobytes()
    assert EFFECTS[effect_id].varies_by_run == varies
