"""The readers of files, called within this process: thousands of spoilt files a minute, without a command around them.

A reader returns, or raises an error of which the command line makes one sentence. Media are left to the commands, which
read them in a child process.
"""

from __future__ import annotations

import random
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from calibration.gauge.geometry import load_gauge
from calibration.store import load_camera
from evaluator.cli.failures import sentence_of
from evaluator.files.reading import read_with
from evaluator.interchange.bags import Topics
from evaluator.interchange.commands import from_log
from evaluator.interchange.poses import read_poses
from evaluator.interchange.tracks import Tracks, read_any_marks
from evaluator.marks import read_marks
from evaluator.settings import load_experiment
from evaluator.tracking.corrections import read_corrections
from evaluator.tracking.settings import load_settings
from simulator.command import Command
from simulator.rendering.scene import load_scene
from simulator.robot import load_robot
from simulator.sweep import load_sweep
from tests.fuzz import mutations
from tests.fuzz.attempt import HangError, limited
from tests.fuzz.bags import BAGS, has_rosbags
from tests.fuzz.mutations import Mutation

LIMIT_S = 30.0
LONGEST_SENTENCE = 20_000  # characters: a file may have many faults
FOREIGN = Tracks.model_validate({"green": "mass A", "yellow": "mass B", "unit": "mm", "rate_hz": 60.0})
TOPICS = Topics(topic="/wheels", poses_topic="/odom")
TEXT, BYTES = mutations.of_text, mutations.of_bytes


@dataclass(frozen=True)
class Reader:
    """A reader, the valid file that is spoilt for it, and the ways to spoil it."""

    name: str
    read: Callable[[Path], object]
    mutations: tuple[Mutation, ...]


def _readers() -> Iterator[Reader]:
    for name, load in (
        ("experiment.toml", load_experiment), ("robot.toml", load_robot), ("gauge.toml", load_gauge),
        ("tracking.toml", load_settings), ("scene.toml", load_scene), ("sweep.toml", load_sweep),
    ):  # fmt: skip
        yield Reader(name, partial(read_with, load), (*[mutations.of_toml] * 3, TEXT, BYTES))
    table = (*[mutations.of_table] * 3, TEXT, BYTES)
    yield Reader("marks.csv", read_marks, table)
    yield Reader("commands.csv", partial(read_with, Command.held), table)
    yield Reader("corrections.csv", read_corrections, table)
    yield Reader("poses.csv", read_poses, table)
    yield Reader("camera.json", partial(read_with, load_camera), (*[mutations.of_json] * 3, TEXT, BYTES))
    for name, ways in (
        ("tracker.txt", table), ("dlc.csv", table), ("run.trk", (TEXT, BYTES)), ("run.trz", (BYTES,)),
        ("movement.nc", (BYTES,)), ("classic.nc", (BYTES,)), ("sleap.h5", (BYTES,)),
    ):  # fmt: skip
        yield Reader(name, partial(read_any_marks, tracks=FOREIGN, marks=("green", "yellow")), ways)
    if has_rosbags():
        for name in BAGS:
            yield Reader(name, partial(read_poses, topics=TOPICS), (BYTES,))
        yield Reader(BAGS[0], partial(from_log, topics=TOPICS), (BYTES,))


READERS = tuple(_readers())


def spoilt(reader: Reader, valid: Path, rng: random.Random) -> bytes:
    """The reader's valid file with one of its mutations."""
    return rng.choice(reader.mutations)(rng, (valid / reader.name).read_bytes())


def attempt(reader: Reader, content: bytes, valid: Path) -> str:
    """Read content beside the valid files; gives "" where that ends with a value or one sentence, else the fault."""
    path = valid / f"spoilt-{reader.name}"
    path.write_bytes(content)
    try:
        with limited(LIMIT_S), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader.read(path)
    except HangError:
        return f"no end within {LIMIT_S:g} s\n{traceback.format_exc(limit=-6)}"
    except BaseException as error:  # noqa: BLE001  # whatever escapes is what we look for
        said = sentence_of(error) if isinstance(error, (ValueError, OSError, MemoryError)) else None
        if not said or len(said) > LONGEST_SENTENCE:
            return f"{''.join(traceback.format_exception(error)[-12:])}{(said or '')[:300]}"
    return ""
