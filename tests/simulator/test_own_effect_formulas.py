"""A user's effect as it is read from the content of its file: parameters, terms, law, and every fault."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from simulator.dynamics.terms import BASES, CHANNELS
from simulator.effects.free_form import scale_of_channel
from simulator.own_effects.files import effect_of, faults_of_content

DRIVE = {"channel": "left_drive", "depends_on": "right_command", "coefficient": "mix", "step": 0.01}
CAMERA = {"channel": "camera_x", "depends_on": "time", "coefficient": "creep", "step": 0.1, "unit": "mm/s"}


def content(*rows: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"format": 1, "id": "own", "name": "a name", "term": list(rows), **more}


def test_terms_that_share_a_parameter_have_its_value_times_their_own_factor() -> None:
    both = {**DRIVE, "low": -2.0, "high": 3.0, "shown": 0.5, "begin": 0.2, "times": 2.0, "unit": "rev"}
    other = {"channel": "friction", "depends_on": "one", "coefficient": "mix", "pattern": "driving", "times": -0.5}
    effect = effect_of(content(both, other, CAMERA, sentence="it mixes"))
    mix, creep = effect.parameters
    assert (mix.name, mix.unit, mix.absent, mix.step, mix.low, mix.high, mix.shown, mix.begin) == (
        *("mix", "rev", 0.0, 0.01, -2.0, 3.0, 0.5, 0.2),
    )
    assert (creep.low, creep.high, creep.shown, creep.begin) == (-math.inf, math.inf, None, None)
    assert (
        effect.law
        == "left_drive += 2·mix·right_command; friction (driving wheels) += -0.5·mix·one; camera_x += creep·time"
    )
    assert (effect.kind, effect.sentence, effect.of_plate) == ("dynamics", "it mixes", effect.of_plate)
    added: list[Any] = []
    draft: Any = SimpleNamespace(add=lambda *terms: added.extend(terms))
    effect.act(draft, {"mix": 3.0, "creep": 7.0})  # type: ignore[misc]
    sizes = [scale_of_channel(CHANNELS[name]) for name in ("left_drive", "friction", "camera_x")]
    assert [(term.channel, term.coefficient, term.pattern) for term in added] == [
        (CHANNELS["left_drive"], pytest.approx(6.0 * sizes[0]), "common"),
        (CHANNELS["friction"], pytest.approx(-1.5 * sizes[1]), "driving"),
    ]
    seen: Any = SimpleNamespace(errors=())
    effect.view(seen, {"mix": 3.0, "creep": 7.0})  # type: ignore[misc]
    assert [(term.channel, term.basis, term.coefficient) for term in seen.errors] == [
        (CHANNELS["camera_x"], BASES["time"], pytest.approx(7.0 * sizes[2]))
    ]
    effect.view(seen, {"mix": 3.0, "creep": 0.0})  # type: ignore[misc]
    assert len(seen.errors) == 1


def test_an_effect_of_the_camera_alone_acts_on_nothing_and_one_of_the_drive_is_not_seen() -> None:
    camera, drive = effect_of(content(CAMERA)), effect_of(content(DRIVE, law="a law"))
    assert (camera.kind, camera.act, drive.kind, drive.view, drive.law) == (
        "observation",
        None,
        "dynamics",
        None,
        "a law",
    )
    assert (drive.sentence, drive.source) == ("a name", "an effect of the user's own")


def row(**more: Any) -> dict[str, Any]:
    return {key: value for key, value in {**DRIVE, **more}.items() if value is not None}


@pytest.mark.parametrize(
    ("told", "faults"),
    [
        (content(DRIVE), []),
        (content(DRIVE, format=2), ["format = 2; this program reads format = 1"]),
        (content(DRIVE, id="Own"), ["id = 'Own'; it must be lower-case letters, digits and hyphens, such as mixed-"]),
        (content(DRIVE, name=3), ["name = 3 must be text"]), (content(DRIVE, law=3), ["law = 3 must be text"]),
        (content(), ["it needs at least one [[term]]"]), (content(DRIVE, term=3), ["it needs at least one [[term]]"]),
        (content(DRIVE, sentense="x"), ["unknown key sentense; did you mean sentence?"]),
        (content(DRIVE, row(setp=1)), ["term 2: unknown key setp; did you mean step?"]),
        (content(row(coefficient="2x")), ["term 1: coefficient = '2x' must be the name of a parameter"]),
        (content(row(unit=3)), ["term 1: unit = 3 must be text"]),
        (content(row(step=True)), ["term 1: step = True is not a finite number"]),
        (content(row(high=math.nan)), ["term 1: high = nan is not a finite number"]),
        (content(row(step=None)), ["term 1: step is missing: the smallest change of the coefficient"]),
        (content(row(step=-1)), ["term 1: step = -1 must be more than 0"]),
        (content(row(low=0.1)), ["term 1: low and high must include 0, where the effect vanishes"]),
        (content(row(high=-0.1)), ["term 1: low and high must include 0, where the effect vanishes"]),
        (content(row(low=0.0, high=0.0)), []), (content(row(high=1.0, begin=1.0)), []),
        (content(row(high=1.0, begin=1.1)), ["term 1: begin = 1.1 must lie within low and high"]),
        (content(row(low=-1.0, begin=-1.1)), ["term 1: begin = -1.1 must lie within low and high"]),
        (content(DRIVE, row(step=None, low=5.0)), []),  # bounds of a shared parameter stand with the first of its terms
        (content(row(channel="left_dive")), ["left_drive"]),
        (content(row(depends_on="u")), ["does not take depends_on u"]),
    ],
)  # fmt: skip
def test_each_fault_of_a_file_is_a_phrase_with_its_place(told: dict[str, Any], faults: list[str]) -> None:
    found = faults_of_content(told)
    assert len(found) == len(faults)
    assert all(wanted in fault for fault, wanted in zip(found, faults, strict=True))
