"""Effects of the user that a process knows, to be made known to the processes that work for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from simulator.effects.catalogue import OWN
from simulator.own_effects.files import file_of, load_installed, load_own

Job = TypeVar("Job")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class KnownEffects:
    """Files of effects, absolute, and whether there are effects of installed packages besides."""

    files: tuple[Path, ...] = ()
    installed: bool = False

    @staticmethod
    def here() -> KnownEffects:
        """Effects of the user that this process knows."""
        sources = [file_of(effect) for effect in OWN]
        return KnownEffects(tuple(source.resolve() for source in sources if source), None in sources)

    def make_known(self) -> None:
        """Load these effects in this process. Raises SimulationError and OSError."""
        if self.installed:
            load_installed()
        for path in self.files:
            load_own(path)


def with_effects(known: KnownEffects, work: Callable[[Job], Answer], job: Job) -> Answer:
    """Do a job in a process that may not know the effects of the process from which the job comes."""
    known.make_known()
    return work(job)
