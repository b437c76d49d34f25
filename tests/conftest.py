"""How pytest -n shares the tests out among its workers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from xdist.remote import Producer
    from xdist.scheduler import Scheduling

# On a fresh clone two workers then begin by compiling different kernels: of the tracker, and of the simulator.
FIRST = ("tests/evaluator/tracking/test_track.py", "tests/simulator/test_integration.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Scheduling | None:
    """Keep the tests of a file in one worker: what they share is made once, not once in every worker."""
    if config.getoption("dist") != "load":  # chosen on the command line
        return None
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False  # the order below counts, not the number of tests in a file
    return LoadFileScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests that compile the most first."""
    items.sort(key=lambda item: not item.nodeid.startswith(FIRST))
