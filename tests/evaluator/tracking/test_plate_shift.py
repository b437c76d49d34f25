"""A camera that does not stand still is seen by the texture of the plate; a still one is not suspected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from calibration import camera_above
from evaluator.recording import Frame
from evaluator.tracking.plate_shift import CLEAR, PlateShift, WithPlate, _Reference
from evaluator.workflow import analyze
from evaluator.workflow.tracking import track_recording
from tests.evaluator.tracking.synthetic import draw, frame_of, turning_marks, write_video

SIZE = 640, 480
SIGMA_PX = 0.05


def texture(contrast: float = 4.0, seed: int = 1) -> np.ndarray:
    """A ground plate, larger than the image."""
    layer = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(560, 720)), (0, 0), 1.5)
    return np.asarray(120.0 + contrast * layer / layer.std())


def seen(plate: np.ndarray, shift: tuple[float, float] = (0.0, 0.0), scale: float = 1.0) -> np.ndarray:
    """The image of a plate, enlarged about the middle of the image, then moved."""
    middle = np.array([SIZE[0], SIZE[1]]) / 2 - 0.5
    offset = middle + np.array(shift) - scale * (middle + 40.0)
    matrix = np.column_stack([scale * np.eye(2), offset])
    return np.asarray(cv2.warpAffine(plate, matrix, SIZE, flags=cv2.INTER_CUBIC))


def recording(images: list[np.ndarray], noise: float = 1.5) -> Iterator[Frame]:
    rng = np.random.default_rng(2)
    for k, image in enumerate(images):
        luma = np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
        yield replace(frame_of(luma), index=37 * k, ticks=37 * k)


def found(images: list[np.ndarray], marks: tuple[float, float] = (320.0, 240.0)) -> PlateShift | None:
    """What is found of images in which both marks are at one place."""
    frames = WithPlate(recording(images))
    table = pd.DataFrame({"frame": [frame.index for frame in frames]})
    for name in ("green", "yellow"):
        table[f"{name}_x_px"], table[f"{name}_y_px"] = marks
        table[f"{name}_x_sigma_px"] = table[f"{name}_y_sigma_px"] = SIGMA_PX
    return frames.found(table, ["green", "yellow"])


@pytest.mark.parametrize("shift", [(0.4, 0.0), (-0.3, 0.35), (2.5, -1.7), (30.0, -12.3)])
def test_a_plate_that_moves_in_the_image_is_told_with_its_shift(shift: tuple[float, float]) -> None:
    plate = texture()
    told = found([seen(plate)] * 2 + [seen(plate, shift)] * 4)
    assert told is not None
    assert told.shift_px == pytest.approx(np.hypot(*shift), rel=0.2)
    assert "the plate moves by" in told.note
    assert "changes in size" not in told.note


def test_a_plate_that_grows_in_the_image_is_told_with_its_scale() -> None:
    plate = texture()
    told = found([seen(plate)] * 2 + [seen(plate, scale=1.004)] * 4)
    assert told is not None
    assert told.scale == pytest.approx(0.004, rel=0.2)
    assert "the plate changes in size by 0.4" in told.note
    assert "moves by" not in told.note


def test_tiles_within_two_distances_of_the_marks_tell_nothing_as_the_robot_moves_there() -> None:
    """A large robot drives 40 px in a corner, then a third of all tiles go with it; the plate is still."""
    plate = _Reference(next(recording([texture()[:480, :640]])))
    marks = np.array([[[80.0, 100.0], [120.0, 100.0]], [[80.0, 200.0], [120.0, 200.0]]])  # each before and now
    near = (np.hypot(*(plate.middles[:, None, None] - marks).transpose(3, 0, 1, 2)) < 190).any(axis=(1, 2))
    assert near.mean() > 0.3  # what does not agree with the others is left out only if it is less
    motion = plate.motion(np.where(near[:, None], [40.0, 0.0], 0.0), np.full(plate.middles.shape, 0.01), marks)
    assert motion is not None
    assert (motion.shift_px, motion.of_scale_px) == (0.0, 0.0)


@pytest.mark.parametrize(("way", "told"), [((0.3, 0.0), False), ((0.0, 0.3), True), ((-0.6, 0.0), True)])
def test_a_shift_along_the_strokes_of_a_brushed_plate_is_told_only_beyond_what_a_codec_gives_to_all_tiles(
    way: tuple[float, float], *, told: bool
) -> None:
    plate = _Reference(next(recording([texture()[:480, :640]])))
    sigma = np.tile([0.19, 0.05], (len(plate.middles), 1))
    motion = plate.motion(np.tile(way, (len(plate.middles), 1)), sigma, [np.full((2, 2), 300.0)] * 2)
    assert motion is not None
    assert motion.shift_px == pytest.approx(np.hypot(*way))
    assert (motion.shift_px > CLEAR * motion.error_px) == told


def test_what_is_no_motion_of_the_plate_is_not_told() -> None:
    plate = texture()
    still = seen(plate)
    darker = [still * (1 - 0.1 * k) for k in range(6)]
    bands = [still * (1 + 0.2 * np.sin(np.arange(SIZE[1]) / 40 + k))[:, None] for k in range(6)]
    damaged = [still] * 3 + [seen(plate, (2.0, 0.0))] * 2 + [still] * 2
    slight = [still] * 2 + [seen(plate, (0.1, 0.05))] * 4
    for images in ([still] * 6, darker, bands, damaged, slight):
        assert found(images) is None


def test_a_large_body_that_moves_over_a_plate_without_texture_is_not_the_plate() -> None:
    body, images = texture(30.0)[:300, :300], []
    for k in range(6):
        image = np.full(SIZE[::-1], 120.0)
        image[20:320, 20 + 9 * k : 320 + 9 * k] = body
        images.append(image)
    assert found(images, (560.0, 420.0)) is None


def test_a_body_of_more_contrast_than_the_plate_does_not_move_it() -> None:
    """Its shift is that of the image as a whole, which the tiles of the plate then contradict only in part."""
    plate, body, images = seen(texture(2.0)), texture(40.0)[:130, :130], []
    for k in range(8):
        image = plate.copy()
        image[180:310, 250 + k : 380 + k] = body
        images.append(cv2.GaussianBlur(image, (0, 0), 0.6))
    assert found(images, (560.0, 420.0)) is None


def test_noise_that_differs_from_frame_to_frame_does_not_move() -> None:
    assert found([np.full(SIZE[::-1], 120.0)] * 6) is None


def film(folder: Path, shift: float) -> Path:
    """A turning robot on a plate that jumps to the right after 13 of 32 frames."""
    rng = np.random.default_rng(3)
    truth = turning_marks(32, (320.0, 240.0), 40.0, 12.0, 0.03)
    grain = texture(6.0)[40 : 40 + SIZE[1], 40 : 40 + SIZE[0]] - 120.0
    images = []
    for k in range(32):
        image = draw(rng, SIZE, {n: tuple(p[k]) for n, p in truth.items()}, 6.0, 0.8, 1.0) + grain[..., None]
        matrix = np.array([[1.0, 0.0, shift * (k > 12)], [0.0, 1.0, 0.0]])
        moved = cv2.warpAffine(image, matrix, SIZE, borderMode=cv2.BORDER_REPLICATE)
        images.append(np.clip(np.rint(moved), 0, 255).astype(np.uint8))
    return write_video(folder / "clip.mkv", images)


@pytest.mark.parametrize(("shift", "told"), [(0.0, False), (2.0, True)])
def test_the_notes_of_a_recording_tell_it(tmp_path: Path, shift: float, *, told: bool) -> None:
    notes = track_recording(film(tmp_path, shift)).notes
    assert any("the plate moves by 2 px" in note for note in notes) == told


def test_the_notes_of_an_analysed_run_tell_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film(tmp_path, 2.0)
    camera = camera_above(size_px=SIZE, focal_px=2000, distance_mm=150)
    monkeypatch.setattr("calibration.store.load_camera", lambda _: camera)
    (tmp_path / "camera.json").write_text("{}", encoding="utf-8")
    experiment = tmp_path / "experiment.toml"
    experiment.write_text(
        'format = 1\nname = "one run"\nrobot = "barrel"\ncamera = "camera.json"\n\n[[run]]\nid = "r01"\n'
        'left_rpm = 14.4\nright_rpm = 33.3\nvideo = "clip.mkv"\n',
        encoding="utf-8",
    )
    notes = analyze(experiment, tmp_path / "out", workers=1).notes["r01"]
    assert any("the plate moves by 2 px" in note for note in notes)
