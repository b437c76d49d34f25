"""Marks of any name: columns, keys and colours follow it."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from evaluator.report.overlay import OTHER, color_of
from evaluator.tracking.settings import TrackingSettings
from simulator.mark_layout import Mark, is_mark_name


@pytest.mark.parametrize("name", ["green", "tail left", "left-front", "_", "1", "vorne é", "前", "a_b-c d"])
def test_a_name_has_letters_and_digits_of_any_script_and_between_them_dashes_and_blanks(name: str) -> None:
    assert Mark(name=name, x_mm=1.0, y_mm=2.0).points_mm() == {name: (1.0, 2.0)}
    assert is_mark_name(name)
    assert TrackingSettings.model_validate({"mark": {name: {"color": "red"}}, "body": [name]}).rigid == (name,)


@pytest.mark.parametrize("name", ["", " ", "a ", "-a", "=1", "a,b", 'a"b', "a.b", "a\n", "a\tb", "a;b", "a/b"])
def test_a_name_begins_and_ends_in_a_letter_or_digit_and_has_nothing_that_parts_columns(name: str) -> None:
    with pytest.raises(ValidationError):
        Mark(name=name, x_mm=1.0, y_mm=2.0)
    with pytest.raises(ValidationError, match="must be letters and digits, with _, - and blanks between them"):
        TrackingSettings.model_validate({"mark": {name: {"color": "red"}}, "body": []})
    assert not is_mark_name(name)


@pytest.mark.parametrize("name", ["green", "green_left", "green left", "green-2"])
def test_the_first_word_of_a_name_is_its_colour(name: str) -> None:
    settings = TrackingSettings.model_validate({"mark": {name: {}}, "body": []})
    assert settings.mark[name].hue_range(name) == settings.mark[name].hue_range("green")
    assert color_of(name) == color_of("green") != OTHER
    assert color_of("greenish") == OTHER
