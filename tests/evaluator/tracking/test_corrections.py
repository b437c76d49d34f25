from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.tracking import correct, read_corrections


def table() -> pd.DataFrame:
    values = {"x_px": [1.0, 2.0], "y_px": [3.0, 4.0], "x_sigma_px": 0.01, "y_sigma_px": 0.01, "xy_cov_px2": 0.0}
    columns = {f"green_{part}": value for part, value in values.items()}
    return pd.DataFrame({"frame": [10, 11], "time_s": [0.0, 0.1], **columns, "green_status": "ok"})


@pytest.mark.parametrize("separator", [",", ";"])
def test_corrections_replace_remove_and_say_so(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "c.csv"
    text = "frame,mark,x,y\n10,green,7.5,8.5\n11,green,absent,\n"
    path.write_text(text if separator == "," else text.replace(",", ";").replace(".", ","))
    corrected = correct(table(), read_corrections(path))
    assert corrected["green_x_px"][0] == 7.5
    assert np.isnan(corrected["green_x_px"][1])
    assert list(corrected["green_status"]) == ["corrected", "absent by hand"]
    assert corrected["green_x_sigma_px"][0] == 0.5


@pytest.mark.parametrize(
    ("line", "said"),
    [("99,green,1,2", "no frame 99"), ("10,red,1,2", "no mark 'red'"), ("10,green,1,", "line 2 needs")],
)
def test_wrong_corrections_are_named(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(f"frame,mark,x,y\n{line}\n")
    with pytest.raises(InputError, match=said):
        correct(table(), read_corrections(path))
