"""What must not matter of a recording does not: the same motion filmed in another way gives the same physics.

The whole chain, from frames to the radius; frames are arrays, so that no codec stands between. Camera: looks straight
down, its axes those of the plate (image y down, plate y up).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.camera import Camera
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import poses_from_marks
from evaluator.recording import Frame
from evaluator.tracking import place_on_plate, track
from evaluator.turning import Turning, measure_turning
from tests.evaluator.synthetic import GREEN_MM, YELLOW_MM
from tests.evaluator.tracking.synthetic import draw, frames_in_memory, turning_marks

Image = NDArray[np.uint8]
SIZE, SCALE, DISTANCE_MM, HEIGHT_MM = (200, 170), 9.0, 206.5, 6.5
FRAMES, TURN_PX, STEP_RAD = 48, 54.0, 0.03
RADIUS_MM, YAW_DEG_S = TURN_PX / SCALE, np.degrees(60 * STEP_RAD)
PLACES = {"green": GREEN_MM, "yellow": YELLOW_MM}


class Clip(NamedTuple):
    """Frames, the camera that took them, and where the marks sit on the robot."""

    frames: list[Frame]
    camera: Camera
    places: dict[str, tuple[float, float]]


def camera(size: tuple[int, int], principal: tuple[float, float], *, focal: float = 1.0, quarters: int = 0) -> Camera:
    """Camera over the plate; focal: over that of SCALE; quarters: image turned counter-clockwise by so many.

    Plate coordinates are turned by half a turn about x, so that y points down, then against the image.
    """
    turned = cv2.Rodrigues(np.array([0.0, 0.0, -np.pi / 2 * quarters]))[0] @ np.diag([1.0, -1.0, -1.0])
    pixels = focal * SCALE * (DISTANCE_MM - HEIGHT_MM)
    rotation = cv2.Rodrigues(turned)[0][:, 0]
    return Camera(size, np.array([*rotation, 0.0, 0.0, DISTANCE_MM, pixels, 1.0, *principal, *np.zeros(6)]))


def drawn(names: dict[str, str], scale: float = 1.0) -> list[Image]:
    """Frames of a robot that turns counter-clockwise on a circle; names: whose place each mark of a colour has."""
    rng = np.random.default_rng(4)
    center = (scale * (100.3 + 0.5) - 0.5, scale * (84.8 + 0.5) - 0.5)
    truth = turning_marks(FRAMES, center, scale * TURN_PX, scale * SCALE, STEP_RAD)
    size = (round(scale * SIZE[0]), round(scale * SIZE[1]))
    return [
        draw(rng, size, {name: tuple(truth[of][k]) for name, of in names.items()}, scale * 4.5, scale * 0.7, 1.0)
        for k in range(FRAMES)
    ]


@cache
def as_drawn() -> list[Image]:
    return drawn({"green": "green", "yellow": "yellow"})


MIDDLE = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)


def frames(images: Iterable[Image]) -> list[Frame]:
    return list(frames_in_memory([image.astype(float) for image in images]))


def as_filmed() -> Clip:
    return Clip(frames(as_drawn()), camera(SIZE, MIDDLE), PLACES)


def turned(quarters: int) -> Clip:
    size = SIZE[::-1] if quarters % 2 else SIZE
    principal = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return Clip(
        frames(np.rot90(image, quarters) for image in as_drawn()), camera(size, principal, quarters=quarters), PLACES
    )


def panned() -> Clip:
    """The camera looks 12 px to the left and 7 px up: the image has moved to the right and down."""
    moved = (np.pad(image, ((7, 0), (12, 0), (0, 0)), mode="edge")[: SIZE[1], : SIZE[0]] for image in as_drawn())
    return Clip(frames(moved), camera(SIZE, (MIDDLE[0] + 12, MIDDLE[1] + 7)), PLACES)


def later() -> Clip:
    return Clip(
        [replace(frame, ticks=frame.ticks + 7200) for frame in frames(as_drawn())], camera(SIZE, MIDDLE), PLACES
    )


def measured(clip: Clip) -> Turning:
    marks = place_on_plate(track(clip.frames), clip.camera, HEIGHT_MM)
    for name in clip.places:
        assert (marks[f"{name}_status"] == "ok").all()
    return measure_turning(poses_from_marks(marks, MarkGeometry(clip.places, height_mm=HEIGHT_MM)))


@pytest.fixture(scope="module")
def plain() -> Turning:
    return measured(as_filmed())


def test_the_radius_and_the_turn_are_those_that_were_drawn(plain: Turning) -> None:
    assert plain.radius_low_mm < RADIUS_MM < plain.radius_high_mm
    assert plain.radius_high_mm - plain.radius_low_mm < 0.01 * RADIUS_MM
    assert plain.yaw_rate_deg_s == pytest.approx(YAW_DEG_S, rel=1e-3)
    center = ((100.3 - MIDDLE[0]) / SCALE, -(84.8 - MIDDLE[1]) / SCALE)
    assert (plain.center_x_mm, plain.center_y_mm) == pytest.approx(center, abs=0.02)


# The same pixels in other places: only sums of pixels are taken in another order.
MOVED: dict[str, Callable[[], Clip]] = {
    "turned by 90 degrees": lambda: turned(1),
    "upside down": lambda: turned(2),
    "turned by 270 degrees": lambda: turned(3),
    "panned": panned,
    "later": later,
}


@pytest.mark.parametrize("change", MOVED)
def test_a_recording_that_is_turned_moved_or_later_gives_the_same_motion_on_the_plate(
    change: str, plain: Turning
) -> None:
    found = measured(MOVED[change]())
    for name in ("radius_mm", "radius_low_mm", "radius_high_mm", "speed_mm_s", "yaw_rate_deg_s"):
        assert getattr(found, name) == pytest.approx(getattr(plain, name), rel=2e-4), name
    assert found.center_x_mm == pytest.approx(plain.center_x_mm, abs=1e-3)
    assert found.center_y_mm == pytest.approx(plain.center_y_mm, abs=1e-3)


def test_a_mirrored_recording_shows_the_mirrored_robot_turning_the_other_way(plain: Turning) -> None:
    mirrored = {name: (x, -y) for name, (x, y) in PLACES.items()}
    found = measured(Clip(frames(image[:, ::-1] for image in as_drawn()), camera(SIZE, MIDDLE), mirrored))
    assert found.radius_mm == pytest.approx(plain.radius_mm, rel=2e-4)
    assert found.speed_mm_s == pytest.approx(plain.speed_mm_s, rel=2e-4)
    assert found.yaw_rate_deg_s == pytest.approx(-plain.yaw_rate_deg_s, rel=2e-4)
    assert found.center_x_mm == pytest.approx(-plain.center_x_mm, abs=1e-3)


def agree(found: Turning, plain: Turning) -> None:
    """Other pixels: the radius is true within its interval, the other's too, and the motion is the same.

    Beyond the interval is one of 20 draws, beyond 1.5 of it one of 300.
    """
    assert abs(found.radius_mm - RADIUS_MM) < 1.5 * (found.radius_high_mm - found.radius_low_mm) / 2
    assert max(found.radius_low_mm, plain.radius_low_mm) < min(found.radius_high_mm, plain.radius_high_mm)
    assert found.yaw_rate_deg_s == pytest.approx(plain.yaw_rate_deg_s, rel=1e-3)
    assert found.speed_mm_s == pytest.approx(plain.speed_mm_s, rel=1e-3)


def test_a_recording_of_half_as_many_pixels_again_scaled_with_its_gauge_agrees(plain: Turning) -> None:
    larger = drawn({"green": "green", "yellow": "yellow"}, 1.5)
    size = (larger[0].shape[1], larger[0].shape[0])
    principal = (1.5 * (MIDDLE[0] + 0.5) - 0.5, 1.5 * (MIDDLE[1] + 0.5) - 0.5)
    agree(measured(Clip(frames(larger), camera(size, principal, focal=1.5), PLACES)), plain)


def test_colours_exchanged_together_with_their_places_on_the_robot_agree(plain: Turning) -> None:
    exchanged = {"green": "yellow", "yellow": "green"}
    places = {name: PLACES[other] for name, other in exchanged.items()}
    agree(measured(Clip(frames(drawn(exchanged)), camera(SIZE, MIDDLE), places)), plain)


def test_half_the_frames_with_their_times_agree(plain: Turning) -> None:
    every = [replace(frame, index=k // 2) for k, frame in enumerate(frames(as_drawn())) if k % 2 == 0]
    found = measured(Clip(every, camera(SIZE, MIDDLE), PLACES))
    agree(found, plain)
    assert found.radius_random_mm > plain.radius_random_mm


def test_a_darker_recording_agrees(plain: Turning) -> None:
    darker = [np.rint(0.7 * image).astype(np.uint8) for image in as_drawn()]
    agree(measured(Clip(frames(darker), camera(SIZE, MIDDLE), PLACES)), plain)
