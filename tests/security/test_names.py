"""Names from files and of files are text everywhere: in spreadsheets, pages and on the terminal."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from evaluator.cli.printable import printable
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.files.csv_tables import write_table
from evaluator.settings import load_experiment
from tests.end_to_end.commands import turnscope
from tests.evaluator.synthetic import circling_marks, three_runs, write_experiment

SCRIPT = "<script>alert(1)</script>"
FORMULA = '=HYPERLINK("http://example.org";"radius")'


@pytest.mark.parametrize("begin", ["=", "+", "-", "@", "\t"])
def test_a_word_that_begins_like_a_formula_is_written_as_text(begin: str, tmp_path: Path) -> None:
    table = pd.DataFrame({"run": ["r01", f"{begin}1+1"], f"{begin}head": [1.5, -2.5], "number": [-3, 4]})
    write_table(table, tmp_path / "t.csv")
    read = pd.read_csv(tmp_path / "t.csv")
    assert read["run"].tolist() == ["r01", f"'{begin}1+1"]
    assert list(read) == ["run", f"'{begin}head", "number"]
    assert read["number"].tolist() == [-3, 4]  # a negative number stays one
    assert list(table) == ["run", f"{begin}head", "number"]  # the table itself is as it was


@pytest.mark.parametrize("run", ["../r01", "/r01", "r/01", ".r01", "r01\n", "=r01", SCRIPT, ""])
def test_an_id_of_a_run_that_could_leave_its_folder_is_refused(run: str, tmp_path: Path) -> None:
    experiment = write_experiment(tmp_path, [("r01", 14.4, 33.3, circling_marks(6.0, seconds=0.1))])
    text = experiment.read_text(encoding="utf-8")
    experiment.write_text(text.replace('id = "r01"', f"id = {run!r}".replace("'", '"')), encoding="utf-8")
    with pytest.raises(InputError, match="id"):
        read_with(load_experiment, experiment)


def test_names_in_a_report_are_text_and_not_part_of_the_page(tmp_path: Path) -> None:
    experiment = three_runs(tmp_path)
    text = experiment.read_text(encoding="utf-8")
    text = text.replace('name = "circles"', f'name = "{SCRIPT}"').replace(
        'marks = "r01.csv"', f"marks = \"r01.csv\"\ngroup = '{SCRIPT}'\nnotes = '{SCRIPT}{FORMULA}'"
    )
    experiment.write_text(text, encoding="utf-8")
    done = turnscope("report", experiment, "-o", tmp_path / "out", "-q", "--workers", 1)
    assert done.returncode == 0, done.stderr
    pages = [path.read_text(encoding="utf-8") for path in (tmp_path / "out").rglob("*.html")]
    assert pages
    assert not [page for page in pages if SCRIPT in page]
    assert "&lt;script&gt;" in pages[0]


def test_no_control_character_of_a_name_reaches_the_terminal() -> None:
    assert printable("a\x1b[31mb\x07\x9b\u202ec\nd\te") == r"a\x1b[31mb\x07\x9b\u202ec" + "\nd\te"
    assert printable("Lauf-ü 運転 −0.5 µm") == "Lauf-ü 運転 −0.5 µm"
