from __future__ import annotations

import tomllib

import pytest

from evaluator.diagnosis.output.robot_file import number, robot_text, with_value, with_values_of_each


@pytest.mark.parametrize(
    "text",
    [
        '# mu\n[slip]\nlateral_friction = 0.25 # mu0_y\nshape = 0.25\n\n[tolerance]\n"slip.lateral_friction" = 0.05\n',
        "slip.lateral_friction = 0.25\nslip.shape = 0.25\n",
        'slip = { "lateral_friction" = 0.25, shape = 0.25 }\n',
        "[body]\nlateral_friction = 0.25\n[slip]\nshape = 0.25\nlateral_friction=0.25",
    ],
)
def test_a_value_changes_in_its_place_and_nothing_else_does(text: str) -> None:
    wanted = tomllib.loads(text)
    wanted["slip"]["lateral_friction"] = 0.24
    changed = with_value(text, "slip", "lateral_friction", 0.24, "before")
    assert tomllib.loads(changed) == wanted
    assert len(changed.splitlines()) == len(text.splitlines())


def test_the_former_value_stays_in_the_comment() -> None:
    text = "[slip]\nlateral_friction = 0.25  # mu0_y\nshape = 1.0\n"
    changed = with_value(text, "slip", "lateral_friction", 0.24, "before")
    assert changed.splitlines()[1] == "lateral_friction = 0.24  # mu0_y; 0.25 before"
    last = with_value("[slip]\nlateral_friction = 0.25", "slip", "lateral_friction", 0.24, "before")
    assert last == "[slip]\nlateral_friction = 0.24  # 0.25 before"


@pytest.mark.parametrize("text", ["[marks]\ndiameter_mm = 1.0\n", "[slip]\nshape = 1.0\n[[effect]]\nid = 'x'\n"])
def test_a_default_that_moved_is_written_into_its_table(text: str) -> None:
    changed = tomllib.loads(with_value(text, "marks", "height_mm", 6.4, "before"))
    assert changed.pop("marks") == {**tomllib.loads(text).get("marks", {}), "height_mm": 6.4}
    assert changed == {key: value for key, value in tomllib.loads(text).items() if key != "marks"}


def test_shipped_robots_have_a_text() -> None:
    assert tomllib.loads(robot_text("barrel"))["format"] == 1


def test_a_value_in_another_unit_stays_in_that_unit() -> None:
    changed = with_value("[body]\nmass_kg = 50.0\n", "body", "mass_g", 51000.0, "before")
    assert tomllib.loads(changed) == {"body": {"mass_kg": 51.0}}


def test_a_value_of_every_table_changes_in_its_own_unit_and_other_tables_do_not() -> None:
    text = "[[wheel]]\nradius_mm = 2.0\n[[wheel]]\nradius_m = 0.003 # rear\n[marks]\nradius_mm = 5.0\n"
    assert with_values_of_each(text, "wheel", "radius_mm", 1.1, "before") == (
        "[[wheel]]\nradius_mm = 2.2  # 2.0 before\n[[wheel]]\nradius_m = 0.0033 # rear; 0.003 before\n"
        "[marks]\nradius_mm = 5.0\n"
    )


@pytest.mark.parametrize(("value", "text"), [(3, "3.0"), (1e-9, "1e-09"), (0.25, "0.25"), (float("nan"), "nan")])
def test_a_number_is_written_as_a_float(value: float, text: str) -> None:
    assert number(value) == text
