"""Values of the robot file that contradict the runs may stand for an effect that is not named."""

from __future__ import annotations

import pytest

from evaluator.report.diagnosis.knowledge import finding_sentences


@pytest.mark.parametrize(("verdict", "change", "told"), [("effect", -0.31, 1), ("effect", 0.29, 0), ("none", -0.31, 0)])
def test_values_of_the_robot_far_beyond_their_tolerances_may_stand_for_a_further_effect(
    verdict: str, change: float, told: int
) -> None:
    nominal = {"slip.lateral_stiffness": {"relative_change": change, "sigma": 0.01, "tolerance": 0.1}}
    said = finding_sentences({"verdict": verdict, "nominal": nominal, "findings": ["stiffness: off"]})
    assert said[0] == "Stiffness: off."
    assert ["a further effect is missing" in sentence for sentence in said[1:]] == [True] * told
