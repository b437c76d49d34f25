from __future__ import annotations

import pytest

from evaluator.report.diagnosis.words import percent_text
from evaluator.report.numbers import number, significant


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
