"""Last position and velocity of a mark, for all kinds of marks."""

from __future__ import annotations

from evaluator.recording import Frame
from evaluator.tracking.observation import OK, Sighting

Point = tuple[float, float]


def beyond(frame: Frame, place: Point, radius_px: float) -> bool:
    """Whether a mark at a position would be cut by the border of the image, or lie outside."""
    return any(not radius_px < at < size - 1 - radius_px for at, size in zip(place, frame.size_px, strict=True))


class Motion:
    """Position and velocity of one mark.

    position, velocity: px, and px/s since the frame before, at time_s; None before it is first seen. missed: frames
    since it was last measured. seen: number of frames in which it was measured. last_sighting: position and time of the
    last frame in which it was seen but not measured.
    """

    position: Point | None
    velocity: Point
    time_s: float
    missed: int
    seen: int
    last_sighting: tuple[Point | None, float]

    def predicted(self, time_s: float) -> Point | None:
        """Predicted position at a time, at constant velocity."""
        if self.position is None:
            return None
        lapse = time_s - self.time_s
        return self.position[0] + self.velocity[0] * lapse, self.position[1] + self.velocity[1] * lapse

    def step_px(self, interval_s: float) -> float:
        """Motion of the mark in an interval: sum over both axes."""
        return (abs(self.velocity[0]) + abs(self.velocity[1])) * interval_s

    def may_be_at(self, place: Point, interval_s: float, slack_px: float) -> bool:
        """Whether it can have reached a position since it was lost; slack_px: added to twice its predicted motion."""
        if self.position is None:
            return True
        reach = slack_px + 2.0 * self.step_px(interval_s) * (1 + self.missed)
        return abs(place[0] - self.position[0]) + abs(place[1] - self.position[1]) < reach

    def move(self, sighting: Sighting, time_s: float) -> bool:
        """Update position and velocity, or count a miss; returns whether it was measured in the previous frame, too."""
        if sighting.status != OK:
            self.missed += 1
            return False
        lapse, steady = time_s - self.time_s, False
        if self.position is not None and self.missed == 0 and lapse > 0:
            self.velocity = (sighting.x - self.position[0]) / lapse, (sighting.y - self.position[1]) / lapse
            steady = True
        elif self.missed > 3:
            self.velocity = (0.0, 0.0)
        self.position, self.time_s, self.missed = (sighting.x, sighting.y), time_s, 0
        return steady
