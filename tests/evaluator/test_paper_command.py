"""turnscope paper from the shell."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from click.testing import CliRunner

from evaluator.cli.group import turnscope

FIGURES = ("3a", "3b", "7a", "7b", "8a", "8b", "9", "10", "11", "12", "13", "14", "18", "20", "21")


def test_paper_writes_every_figure_its_data_the_numbers_and_one_page(tmp_path: Path) -> None:
    run = CliRunner().invoke(turnscope, ["paper", "-o", str(tmp_path)])
    assert run.exit_code == 0, run.output
    names = {path.name for path in tmp_path.iterdir()}
    wanted = {f"figure-{figure}.{kind}" for figure in FIGURES for kind in ("svg", "csv")}
    assert names == wanted | {"index.html", "numbers.csv", "readings.csv"}
    numbers = pd.read_csv(tmp_path / "numbers.csv")
    assert set(numbers["verdict"]) <= {"agrees", "close", "differs", "holds", "fails", "not computed"}
    assert all(value in run.output for value in ("52.52", "46.3", "18.27", "52.06", "15.73", "2.5735", "−1.5141"))
    worth = {"computed", "fitted to this figure", "conjecture", "not reproduced", "out of scope"}
    assert set(numbers["standing"]) == worth
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    for said in (run.output, page):
        assert all(word in said for word in worth)
        assert "Not reproduced: Fig. 19, 22, backward turn against forward turn: published: tighter" in said
    assert "var(--" not in (tmp_path / "figure-14.svg").read_text()
