from __future__ import annotations

import pytest

from evaluator.report.diagnosis.sections import _small_print
from evaluator.report.diagnosis.values import percent_text
from evaluator.report.numbers import number, significant
from evaluator.report.pages.html import prose
from evaluator.wording import name_of_value, power_of_ten, with_bounds


@pytest.mark.parametrize(
    ("value", "text"),
    [(6.0, "6.00"), (63.36, "63.4"), (99.97, "100"), (1234.5, "1234"), (-0.01234, "−0.0123"), (0.0, "0")],
)
def test_three_figures_are_three_figures_and_never_a_power(value: float, text: str) -> None:
    assert significant(value) == text


def test_nothing_is_neither_negative_nor_a_power() -> None:
    assert number(-0.001, 2, sign=True) == "+0.00"
    assert [percent_text(share) for share in (0.997, 0.821, 0.036, 0.0061, 0.00001, None)] == [
        "100 %", "82 %", "3.6 %", "0.61 %", "< 0.01 %", "–",
    ]  # fmt: skip


def test_noise_on_ground_claims_no_friction_of_single_runs() -> None:
    noise = {"mark_sigma_mm": 80.0, "correlation_s": 0.3}
    for scatter, said in (
        (None, "this includes the scatter from run to run"),
        ({"friction": 0.02, "wheel_speed": 0.004}, "friction scatters by 2.0 % and wheel speed by 0.40 %"),
    ):
        section = _small_print({"noise": {**noise, "run_to_run": scatter}})
        assert section is not None
        assert said in " ".join(section.text)


def test_drift_of_both_marks_is_said_where_there_is_one() -> None:
    noise = {"mark_sigma_mm": 0.003, "correlation_s": 0.3}
    for drift_mm, said in ((0.0083, True), (0.0, False)):
        section = _small_print({"noise": {**noise, "common_drift_mm": drift_mm}})
        assert section is not None
        assert ("Both marks drift together by 8.3 µm" in " ".join(section.text)) == said


def test_friction_that_changes_along_the_way_is_said_where_it_does() -> None:
    noise = {"mark_sigma_mm": 0.003, "correlation_s": 0.3}
    for change, said in ((0.016, True), (0.0, False)):
        section = _small_print({"noise": {**noise, "friction_in_10_mm": change}})
        assert section is not None
        assert ("Friction varies by 1.6 % over 10 mm" in " ".join(section.text)) == said


@pytest.mark.parametrize(
    ("three", "shown"),
    [
        ((-0.00879, -0.0175, -5.35e-5), ("-0.009", "-0.018", "0.000")),
        ((8.5e-7, -1.96e-4, 1.97e-4), ("0.00000", "-0.00020", "0.00020")),
        ((1234.56, 1200.0, 1270.0), ("1235", "1200", "1270")),
        ((0.25, 0.25, 0.25), ("0.25", "0.25", "0.25")),
        ((0.4885, 0.0944, 5.0), ("0.5", "0.1", "5.0")),  # a factor, of which little is known above
        ((1e-4, 0.0, 5.0), ("0.0", "0.0", "5.0")),
        ((101.7874176900073, 101.7874176900072, 101.7874176900074), ("101.787418",) * 3),
    ],
)
def test_a_value_and_its_bounds_have_the_decimals_that_their_distance_bears(
    three: tuple[float, float, float], shown: tuple[str, str, str]
) -> None:
    assert with_bounds(*three) == shown


def test_a_factor_beyond_all_digits_is_written_as_a_power() -> None:
    assert power_of_ten(608.2) == "10⁶⁰⁸"


def test_prose_shows_code_as_code_and_markup_as_text_and_keeps_numbers_with_their_units() -> None:
    assert prose("Made by `turnscope render *.toml`.") == "Made by <code>turnscope render *.toml</code>."
    assert prose("`<b>`") == "<code>&lt;b&gt;</code>"
    assert prose("(95 %: 3.1 to 3.2 mm; run 5 mmx, −5 / −33 rpm)") == (
        "(95\u00a0%: 3.1 to 3.2\u00a0mm; run 5 mmx, −5\u00a0/\u00a0−33\u00a0rpm)"
    )


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("slip.lateral_friction", "lateral friction"),
        ("wheels.track_mm", "track"),
        ("wheel.x_mm", "wheelbase"),
        ("wheel.radius_mm", "radius of the wheels"),
        ("magnetic_attraction.driven_wheel_mN", "attraction of a driven wheel"),
    ],
)
def test_values_of_a_robot_file_have_names(key: str, name: str) -> None:
    assert name_of_value(key) == name
