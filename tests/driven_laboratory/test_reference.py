"""The world of wheeled robots moves as turnscope's simulation does, from which it takes nothing."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simulator.command import RPM_PER_RAD_S, Command
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.driven_laboratory.reference import STEP_S, drive
from tests.driven_laboratory.session import KINDS, Motors, Session, draw, moves, parameters, surface_rad_s, write

FEW_S = 9.0  # of a recording


def driven(kind: str, slides: bool) -> Session:
    """A short session of a kind by a robot that is what its file says, but for the kind."""
    found = draw(kind, 3)
    # Four wheels share a load that is aside and ahead in a way that statics leaves open: ahead only.
    hidden = {name: getattr(found.true, name) for name in ("centre_of_gravity_m", "slope", "viscous_N_s_m", "scrub_m")}
    hidden["centre_of_gravity_m"] = (hidden["centre_of_gravity_m"][0], 0.0)
    true = replace(found.said, slides=slides, **hidden)
    said = replace(found.said, slides=slides)
    first = replace(_first(found), said=said, true=true, motors=Motors())
    return replace(first, friction=np.ones(1), late_s=np.zeros(1))


@pytest.mark.parametrize(
    ("kind", "slides"),
    [("none", True), ("none", False), ("payload", True), ("slope", True), ("drag", True), ("scrub", True)],
)
def test_a_recording_is_that_of_the_simulation_with_the_effect(kind: str, slides: bool, tmp_path: Path) -> None:
    session = driven(kind, slides)
    write(session, tmp_path, tmp_path / "truth")
    text = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    effect = KINDS[kind][0]
    if effect:
        lines = [f"{name} = {value:.9g}" for name, value in parameters(session).items()]
        text += "\n".join(["[[effect]]", f'id = "{effect}"', *lines])
        (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    exact = drive(session.true, 1.0, surface_rad_s(session, 0), session.start[0])
    times, rows = session.commands[0]
    command = Command.steps((float(at), *(RPM_PER_RAD_S * row).tolist()) for at, row in zip(times, rows, strict=True))
    at = np.arange(0.0, FEW_S, 0.1)
    x, y, heading = session.start[0]
    run = simulate(load_robot(tmp_path / "robot.toml"), command, at, State(1000 * x, 1000 * y, heading))
    poses = exact[np.round(at / STEP_S).astype(int)]
    size = session.said.wheelbase_m
    assert np.hypot(run.x_mm / 1000 - poses[:, 0], run.y_mm / 1000 - poses[:, 1]).max() < 3e-3 * size
    assert np.abs(run.heading_rad - poses[:, 2]).max() < 2e-3
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() > size


def test_the_world_takes_nothing_from_turnscope() -> None:
    for name in ("reference.py", "session.py"):
        tree = ast.parse((Path(__file__).parent / name).read_text(encoding="utf-8"))
        modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        modules += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        assert not any(module.split(".")[0] in ("simulator", "evaluator", "calibration") for module in modules)


def test_a_session_is_that_of_its_seed_and_says_nothing_of_what_it_hides(tmp_path: Path) -> None:
    one, other = draw("payload", 5), draw("payload", 5)
    assert one.true == other.true
    assert draw("payload", 6).true != one.true
    assert one.true.centre_of_gravity_m != one.said.centre_of_gravity_m == (0.0, 0.0)
    session = driven("payload", slides=True)
    path = write(session, tmp_path / "in", tmp_path / "truth")
    assert sorted(file.name for file in path.parent.iterdir()) == [
        "experiment.toml", "r01.csv", "r01_commands.csv", "robot.toml",
    ]  # fmt: skip
    assert "payload" not in "".join(file.read_text(encoding="utf-8") for file in path.parent.iterdir())


def test_how_far_what_is_missing_moves_a_robot_is_told_in_its_noise() -> None:
    """Friction that fades hardly changes the paths of seed 17: "none" is the right verdict there."""
    assert moves(_first(draw("none", 3))) < 1e-9
    assert moves(_first(draw("fading", 17))) < 0.2
    assert moves(_first(draw("drag", 3))) > 1.0


def _first(session: Session) -> Session:
    """The first seconds of its first recording alone."""
    times, rows = session.commands[0]
    kept = times < FEW_S
    few = [(np.append(times[kept], FEW_S), np.vstack([rows[kept], [[0.0, 0.0]]]))]
    given = {name: getattr(session, name)[:1] for name in ("friction", "start", "late_s")}
    return replace(session, commands=few, **given)
