"""What tracking.toml may not hold, in one sentence with the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.tracking import load_settings


def test_marks_of_the_robot_in_tracking_toml_are_sent_to_robot_toml(tmp_path: Path) -> None:
    path = tmp_path / "tracking.toml"
    path.write_text('format = 1\n[[mark]]\nname = "green"\nx_mm = 1.0\n')
    with pytest.raises(InputError, match=r"\[\[mark\]\] belongs in robot.toml.* \[mark.NAME\]") as error:
        read_with(load_settings, path)
    assert "\n" not in str(error.value)
