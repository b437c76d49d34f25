"""Follow a mark that is not a disc: a sticker, a coloured roof, a ball with motion blur."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.following.motion import Motion, Point, beyond
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.refinement.blob import Blob, blobs_around, extends_beyond

Array = NDArray[np.float64]

# Ratio of the soft area to its usual value. Below, a part is hidden or smeared until its colour is lost; above, an
# object of the same colour touches the mark.
LEAST, MOST = 0.6, 1.7
EXTENT = 0.45  # of a mark's chroma beyond that of its surroundings: less is not of its colour, as `learn_color` has it
FADED = 0.55  # of the usual chroma: codec residue of a mark is paler than the mark
RATE = 0.2  # weight of a new area or chroma in the usual one: slant and distance change them within a dozen frames
RIM = 0.1  # of a blob's chroma: less chroma around it changes its threshold by less than 12 %
SIMILAR = 0.5  # of the chroma beside a blob: what has more, and touches it, is the floor or the rim that it measured
SOUGHT = 0.2  # of the usual area: smaller blobs are ignored
OUTLINE = 1.0  # variance of the centre over (relative variance of the area × spread), measured in clips of known truth
SLOWLY, SETTLED = 0.05, 10  # weight of a new squared change of the area; frames after which outliers are limited
SMALLEST_PX = 4.0  # least distance around a position within which the blob is looked for
SHUTTER = (0.5, 12**-0.5)  # open share of the interval and its standard uncertainty: uniform from 0 to 1
NEARBY = 3.0  # radii: largest distance of a mark from its predicted position while its speed is unknown


class Look(NamedTuple):
    """Properties of a blob that a search needs; fields as in `Appearance`."""

    area_px2: float


def start_blob(
    frame: Frame, cell: Array, place: Point, radius_px: float, color: Array, exposure: float | None
) -> BlobFollower:
    """Begin to follow a blob found at a position; its radius is of the part above a threshold, perhaps a small part."""
    reach = max(2.0 * radius_px, SMALLEST_PX)
    blobs = blobs_around(frame, cell, color, place, reach, SOUGHT * np.pi * radius_px**2)
    near = [one for one in blobs if np.hypot(*np.subtract(one.center_px, place)) < reach]
    area = max((one.area_px2 for one in near), default=np.pi * radius_px**2)
    follower = BlobFollower(color.copy(), area, exposure)
    follower.position, follower.time_s = place, frame.time_s
    return follower


@dataclass
class BlobFollower(Motion):
    """Tracker of one blob: last position, velocity and size.

    color: argument of `color_kernels.is_color`. area_px2: usual soft area. radius_px: of the disc of that area.
    """

    color: Array
    area_px2: float
    exposure: float | None
    position: Point | None = None
    velocity: Point = (0.0, 0.0)
    time_s: float = 0.0
    missed: int = 0
    seen: int = 0
    last_sighting: tuple[Point | None, float] = (None, 0.0)
    long_px: float = 0.0  # half the longest axis
    blob: Blob | None = field(default=None)  # as last measured
    unsteady: float = 1e-6  # variance of the logarithm of the area
    areas: tuple[float, ...] = ()  # logarithms of the last three
    outline: list[tuple[float, float, float, float]] = field(default_factory=list)  # argument of `widen_by_outline`

    def __post_init__(self) -> None:
        """Compute what follows from the arguments."""
        self.shutter = SHUTTER if self.exposure is None else (self.exposure, 0.0)
        self.strength = self.color[4] / EXTENT
        self.long_px = self.long_px or 2.0 * self.radius_px

    @property
    def radius_px(self) -> float:
        """Radius of the disc of equal area."""
        return float(np.sqrt(self.area_px2 / np.pi))

    @property
    def look(self) -> Look:
        """Properties that a search for it uses."""
        return Look(self.area_px2)

    def look_at(self, frame: Frame, cell: Array, place: Point, reach_px: float, interval_s: float) -> Sighting:
        """Measure the mark near a place of the frame; as `Follower.look_at`."""
        del interval_s
        return self._look(frame, cell, place, reach_px, 1.0)

    def look_again(
        self, frame: Frame, cell: Array, place: Point, interval_s: float, guide: Point, light: float
    ) -> Sighting:
        """Measure a lost mark at a position found by a search of the whole image; as `Follower.look_again`."""
        del interval_s, guide
        return self._look(frame, cell, place, self.radius_px, min(light, 1.0))

    def _look(self, frame: Frame, cell: Array, place: Point, reach_px: float, light: float) -> Sighting:
        color = self.color.copy()
        color[4] *= light
        half = self.long_px + reach_px + 2.0 * float(cell[0])
        blobs = blobs_around(frame, cell, color, place, half, SOUGHT * self.area_px2)
        slack = reach_px + 0.5 * self.radius_px + 1.0
        near = [one for one in blobs if max(abs(np.subtract(one.center_px, place))) < slack]
        if not near:
            return ABSENT["outside the image" if beyond(frame, place, self.radius_px) else "not seen"]
        near.sort(key=lambda one: self._unlike(one, place, slack))
        best = next((one for one in near if not self._fault(one, light)), near[0])
        if fault := self._fault(best, light):
            return ABSENT[fault]
        self.blob = self._without_own_rim(best, frame, cell, half)
        # If a codec cuts or smears the outline, the errors of area and centre are correlated: a missing share of the
        # area at one end moves the centre by this share of the length.
        covariance = best.covariance_px2 + OUTLINE * self.unsteady * best.spread_px2
        (var_x, cov_xy), (_, var_y) = covariance.tolist()
        return Sighting(*best.center_px, var_x, var_y, cov_xy, OK)

    def _without_own_rim(self, one: Blob, frame: Frame, cell: Array, half_px: float) -> Blob:
        """The blob, without the chroma around it if that is a paler part of the mark (a shaded ball) and no floor.

        Otherwise its threshold would rise until only its most colourful part is left.
        """
        paler = self.color.copy()
        paler[4] = SIMILAR * one.beside
        if one.beside < RIM * one.strength or extends_beyond(
            frame, cell, paler, one.center_px, 2.0 * half_px, MOST * self.area_px2
        ):
            return one
        return replace(one, beside=0.0)

    def _fault(self, one: Blob, light: float) -> str:
        """Why a blob is not the mark as it usually is; "" if it may be."""
        ratio = one.area_px2 / self.area_px2
        if not one.whole:
            return "outside the image"
        if one.strength < FADED * light * self.strength:
            return "faded"
        if not LEAST < ratio < MOST:
            return "partly hidden" if ratio < 1.0 else "ambiguous"
        return ""

    def _unlike(self, one: Blob, place: Point, slack: float) -> float:
        """Dissimilarity of a blob to the mark, in size and position."""
        far = float(np.hypot(*np.subtract(one.center_px, place))) / slack
        return far + abs(float(np.log(one.area_px2 / self.area_px2)))

    def accept(self, sighting: Sighting, time_s: float) -> None:
        """Update the state with a measurement, or count a miss."""
        self.move(sighting, time_s)
        if sighting.status == OK and self.blob is not None:
            self.seen += 1
            rate = max(RATE, 1.0 / self.seen)
            self._note_area(float(np.log(self.blob.area_px2)))
            self.area_px2 += rate * (self.blob.area_px2 - self.area_px2)
            self.strength += rate * (self.blob.strength - self.strength)
            beside = max(self.blob.beside, 0.0)  # a floor of nearly the colour is not the mark
            change = beside + EXTENT * (self.strength - beside) - self.color[4]
            # A threshold that falls fast would make the mark larger than it may become from one frame to the next.
            self.color[4] += (rate if change > 0.0 else RATE) * change
            # A bar of length l has a variance of l²/12 along it, an ellipse one of l²/16.
            (short, long), axes = np.linalg.eigh(self.blob.spread_px2)
            self.long_px = 2.0 * float(np.sqrt(max(long, 0.0)))
            sides = float(np.sqrt(12.0 * max(long, 0.0))), float(np.sqrt(12.0 * max(short, 0.0)))
            self.outline.append((time_s, *sides, float(np.arctan2(axes[1, 1], axes[0, 1]))))

    def _note_area(self, log_area: float) -> None:
        """Update the variance of the area, without slow changes of slant and distance."""
        self.areas = (*self.areas[-2:], log_area)
        if len(self.areas) == 3:
            first, middle, last = self.areas
            # A second difference has six times the variance of one value; single outliers are limited.
            square = min((first - 2.0 * middle + last) ** 2 / 6.0, 9.0 * self.unsteady if self.seen > SETTLED else 1.0)
            self.unsteady += max(SLOWLY, 1.0 / self.seen) * (square - self.unsteady)


def look_back(
    followers: Mapping[str, object], names: Sequence[str], before: Sequence[tuple[Frame, list[Sighting]]], cell: Array
) -> int:
    """Measure blobs in the frames before they were begun, in place; returns the number of first frames without any.

    names: of the marks, in the order of the sightings.
    """
    missed = len(before)
    for k, name in enumerate(names):
        begun = followers.get(name)
        if not isinstance(begun, BlobFollower) or begun.position is None:
            continue
        blob = replace(begun, outline=[])
        place, step = np.array(begun.position), np.zeros(2)
        for row, (frame, sightings) in reversed(list(enumerate(before))):
            x, y = (place + step).tolist()
            one = blob.look_at(frame, cell, (x, y), NEARBY * blob.radius_px, 0.0)
            if one.status != OK:
                break
            sightings[k], missed = one, min(missed, row)
            place, step = np.array([one.x, one.y]), np.array([one.x, one.y]) - place
    return missed
