"""How pytest -n shares the tests out among its workers, and what no test leaves behind."""

from __future__ import annotations

import gc
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from xdist.remote import Producer
    from xdist.scheduler import Scheduling

# Threads that share a small matrix wait for each other, busily, and the cores belong to the workers of pytest -n: fits
# of noise took 1.5 times the processor time. Read by libraries that are still to be loaded, and by processes of tests.
for _name in ("OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The C library of Linux gives the memory of large arrays back at once and has its pages made anew for the next frame:
# an eighth of the processor time of tests of the tracker. Up to 32 MiB, the most it allows, arrays stay in its heap, of
# which 256 MiB stay with the process. Read when a process starts: a worker of pytest -n, or a process of a test.
for _name, _mib in (("MALLOC_MMAP_THRESHOLD_", 32), ("MALLOC_TRIM_THRESHOLD_", 256)):
    os.environ.setdefault(_name, str(_mib * 2**20))

# Python looks for garbage after every 700 new objects, and collecting the tests alone leaves half a million: that was a
# tenth of the processor time.
NEW_OBJECTS = 50_000

# On a fresh clone two workers then begin by compiling different kernels: of the tracker, and of the simulator.
FIRST = ("tests/evaluator/tracking/test_track.py", "tests/simulator/test_integration.py")


def pytest_configure() -> None:
    """Keep libraries that a plugin has loaded already to one thread, too; draw the same examples on every machine."""
    # A failure is then one of what was changed; the usual limits of time are claims about a machine.
    quietly = [HealthCheck.too_slow]
    settings.register_profile("turnscope", deadline=None, derandomize=True, suppress_health_check=quietly)
    settings.load_profile("turnscope")
    if "numpy" in sys.modules and find_spec("threadpoolctl"):
        from threadpoolctl import threadpool_limits

        threadpool_limits(int(os.environ["OPENBLAS_NUM_THREADS"]), user_api="blas")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker of pytest -n auto more than cores: tests that wait for a browser or a process leave a core idle."""
    from evaluator.workflow.execution.machine import available_cores

    return available_cores() + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Scheduling | None:
    """Keep the tests of a file in one worker: what they share is made once, not once in every worker."""
    if config.getoption("dist") != "load":  # chosen on the command line
        return None
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # the order below counts, not the number of tests in a file
    return LoadFileScheduling(config, log)


class Elsewhere(pytest.Dir):
    """A folder of tests that each worker begins to read at another place."""

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        """The files and folders, from the worker's own part on."""
        found = list(super().collect())
        worker = getattr(self.config, "workerinput", {"workerid": "gw0", "workercount": 1})
        first = len(found) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        yield from found[first:] + found[:first]


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Let a worker find two thirds of the tests compiled by the others.

    pytest compiles assertions anew: on a fresh clone two thirds of the time until the first test, in every worker.
    """
    return None if (path / "__init__.py").is_file() else Elsewhere.from_parent(parent, path=path)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests that compile the most first, and the others in the same order in every worker."""
    items.sort(key=lambda item: (not item.nodeid.startswith(FIRST), item.path))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for garbage seldom, and never among modules and tests, which stay to the end."""
    gc.disable()
    found = yield
    gc.freeze()
    gc.set_threshold(NEW_OBJECTS)
    gc.enable()
    return found


@pytest.fixture(scope="module", autouse=True)
def _own_effects_forgotten() -> Iterator[None]:
    """Own effects are known to the whole process: tests of other files must not meet them."""
    yield
    if files := sys.modules.get("simulator.own_effects.files"):
        files.forget_own()
