"""The page of the file formats says what the models check."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from evaluator.templates.formats import COMMAND, PAGE, _default, _json_type, _type, notes_of, page
from evaluator.turning import Turning


def test_the_page_is_the_one_that_the_models_make() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), f"run {COMMAND}"


def test_keys_of_every_file_and_every_effect_are_there() -> None:
    text = page()
    for heading in ("experiment", "robot", "gauge", "tracking", "scene", "sweep"):
        assert f"## {heading}.toml" in text
    for place in ("[[run]]", "[known_to]", "[relevant]", "[body]", "[slip]", "[[mark]]", "[dots]", "[mark.NAME]"):
        assert f"### `{place}`" in text
    for key in ("lateral_friction", "pitch_mm", "start_per_run_s", "hue_deg", "shifted_rows", "stiffness_mN_mm"):
        assert f"`{key}`" in text
    assert all(f"`{name}`" in text for name in Turning().to_row())


def test_keys_of_diagnosis_json_are_there_each_with_the_object_that_holds_it() -> None:
    text = page().split("## diagnosis.json")[1]
    for place in ("effects", "effects.parameters", "gap.by_run", "next_experiment.runs"):
        assert f"### `{place}`" in text
    assert "| `held_out_gain_sigmas` | number or null | significance" in text
    assert "| `nominal` | objects by name | by dotted key of robot.toml |" in text


def test_types_of_json_in_words() -> None:
    found = {kind: _json_type(kind) for kind in (list[str], dict[str, float | None], str | None, list[Literal["a"]])}
    assert list(found.values()) == ["list of text", "number or null by name", "text or null", "list of text"]


class Below(BaseModel):
    """A table below."""

    word: Literal["a", "b"] = "a"


class Sample(BaseModel):
    """A table."""

    size: Annotated[float, Field(gt=0, le=2)]  # of the thing
    count: int | None = None
    place: tuple[float, float] = (1.0, -0.5)
    below: tuple[Below, ...] = ()
    on: bool = True


def test_types_bounds_defaults_and_notes_of_a_model() -> None:
    fields = Sample.model_fields
    said = {name: (_type(item.annotation, item.metadata), _default(item)) for name, item in fields.items()}
    assert said == {
        "size": ("number > 0 ≤ 2", "required"),
        "count": ("whole number", ""),
        "place": ("[number, number]", "`[1, -0.5]`"),
        "below": ("tables", ""),
        "on": ("true or false", "`true`"),
    }
    (word,) = Below.model_fields.values()
    assert (_type(word.annotation, word.metadata), _default(word)) == ('`"a"`, `"b"`', '`"a"`')
    from evaluator.settings import KnownTo

    assert notes_of(KnownTo)["start_common_s"] == "offset of start_s common to all runs; default: one frame"
