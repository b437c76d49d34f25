"""Shapes that are learnt again during tracking, step by step, so that no frame waits for a whole fit."""

from __future__ import annotations

from collections.abc import Sequence

from evaluator.tracking.detection.appearance import with_disc
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.refinement.disc import Disc
from evaluator.tracking.refinement.learn_shape import Patch, Steps

STEPS = 1  # of a fit, in each frame: 1 ms for a mark of 20 px radius
LEARNING_FRAMES = 12  # from which a shape is learnt; more do not improve the centre, which is orthogonal to the shape


class Lessons:
    """Queue of marks whose shapes are being learnt."""

    def __init__(self) -> None:
        """Start without any."""
        self._waiting: list[tuple[Follower, Steps[Disc | None]]] = []

    def __len__(self) -> int:
        """Number of marks whose shapes are being learnt."""
        return len(self._waiting)

    def begin(self, follower: Follower, views: Sequence[Patch], interval_s: float) -> None:
        """Learn the shape of a mark from views evenly spread over all, at most LEARNING_FRAMES."""
        chosen = views[:: -(-len(views) // LEARNING_FRAMES)]
        self._waiting.append((follower, follower.learn_anew(chosen, interval_s)))

    def go_on(self) -> bool:
        """Take the next steps; returns whether a mark took a new shape."""
        follower, steps = self._waiting[0]
        try:
            for _ in range(STEPS):
                next(steps)
        except StopIteration as end:
            del self._waiting[0]
            if end.value is not None:
                follower.take_shape(with_disc(follower.look, end.value))
                return True
        return False
