"""Files of drawn experiments: the product accepts them, a seed fixes them, and they say nothing of what is hidden."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.commands import turnscope
from tests.laboratory import mess, odd
from tests.laboratory.experiment import draw, ordinary_session, write
from tests.laboratory.reference import Now, Sliding
from tests.laboratory.session import true_marks

HERE = Path(__file__).parent


def written(folder: Path, kind: str, name: str, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    write(draw(kind, name, rng), folder / "a1", folder / "truths", rng)
    return folder / "a1"


def test_turnscope_accepts_the_files(tmp_path: Path) -> None:
    experiment = written(tmp_path, "mess", "everything", 3) / "experiment.toml"
    done = turnscope("check", experiment)
    assert done.returncode == 0, done.stderr
    assert "no errors" in done.stdout


def test_equal_seeds_write_equal_files_without_the_truth(tmp_path: Path) -> None:
    first, second = (written(tmp_path / which, "odd", "pushed", 5) for which in ("one", "two"))
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    assert len(files) >= 18
    assert all((first / path).read_bytes() == (second / path).read_bytes() for path in files)
    # and the folder of the diagnosis does not hold the truth
    truth = json.loads((tmp_path / "one" / "truths" / "a1.json").read_text(encoding="utf-8"))
    texts = " ".join(path.read_text(encoding="utf-8") for path in first.glob("*.toml"))
    assert truth["odd"]["kinds"] == ["pushed"]
    assert "pushed" not in texts
    assert "odd" not in texts


@pytest.mark.parametrize("name", mess.KINDS)
def test_every_mess_leaves_enough_frames(name: str) -> None:
    rng = np.random.default_rng(1)
    session = mess.KINDS[name](ordinary_session(rng), rng)
    assert (session.end_s - np.maximum(session.begin_s, session.start_s) > 1.0).all()


def test_three_runs_of_a_session_turn_on_the_spot_if_asked() -> None:
    plain, turned = (ordinary_session(np.random.default_rng(4), pivots=pivots) for pivots in (False, True))
    on_the_spot = turned.said_rpm[0] * turned.said_rpm[1] < 0
    assert (on_the_spot.sum(), plain.runs) == (3, turned.runs)
    assert (plain.said_rpm.prod(axis=0) > 0).all()
    np.testing.assert_array_equal(plain.said_rpm[:, ~on_the_spot], turned.said_rpm[:, ~on_the_spot])


def test_there_are_twenty_kinds_of_mess_and_more() -> None:
    assert len(mess.KINDS) > 20


def test_an_odd_run_differs_from_its_tidy_self_and_others_do_not() -> None:
    rng = np.random.default_rng(2)
    session = ordinary_session(rng)
    changed, kinds = session, ("reversed", "stuck", "quits-half-way", "pushed", "late-start", "wrong-robot")
    for run, name in enumerate(kinds):
        changed = odd.KINDS[name](changed, run, rng)
    both = zip(true_marks(session), true_marks(changed), strict=True)
    moved = [float(np.abs(plain[1] - other[1]).max()) for plain, other in both]
    assert min(moved[: len(kinds)]) > 0.05, dict(zip(kinds, moved, strict=False))
    assert max(moved[len(kinds) :]) < 1e-3  # all runs share the steps of one solver


def test_an_unevenly_clean_plate_differs_from_place_to_place_by_one_to_two_per_cent() -> None:
    rng = np.random.default_rng(3)
    (friction,) = mess.plate_unevenly_clean(ordinary_session(rng), rng).world.frictions
    x_mm, y_mm = rng.uniform(-300, 300, (2, 4, 5000))
    still = np.zeros_like(x_mm)
    now = Now(*[still[0]] * 9, still)
    factors = friction(now, Sliding(x_mm, y_mm, still, still))
    assert factors.shape == (4, 5000)
    assert 0.009 < float(np.std(factors)) < 0.021
    near = friction(now, Sliding(x_mm + 1.0, y_mm, still, still))
    assert float(np.std(near - factors)) < 0.5 * float(np.std(factors))  # a millimetre on it is much the same


def test_the_laboratory_imports_nothing_that_it_judges() -> None:
    for file in HERE.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {name.split(".")[0] for name in names} & {"simulator", "evaluator", "calibration", "numba"}, file
