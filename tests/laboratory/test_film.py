"""The filmed laboratory shows things where its camera says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from tests.laboratory.film import Shape, Studio, camera_above, disc, random_look, write_video
from tests.laboratory.reference import Array


def studio(seed: int = 4) -> Studio:
    """A small camera almost without noise on an even plate."""
    rng = np.random.default_rng(seed)
    look = replace(random_look(rng), noise=(1e-4, 1e-4), mosaic=False, slope=(0.0, 0.0), shading=0.0)
    made = Studio(camera_above(rng, 30.0, (320, 240)), look, rng)
    made.empty[:] = 0.2
    return made


def centre_px(image: Array) -> Array:
    """Centroid of light above the plate, of an image with its gamma undone."""
    light = (image[..., 1] / 255.0) ** 2.2
    weight = np.maximum(light - np.median(light) - 0.02, 0)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()


def test_disc_is_drawn_where_the_camera_projects_it() -> None:
    film = studio()
    for place in ((0.0, 0.0, 6.5), (6.3, -4.2, 6.5), (-7.7, 3.1, 0.0)):
        rim = disc(*place, 0.6)
        seen = centre_px(film.image([Shape(rim, (0.8, 0.8, 0.8))]))
        expected = film.camera.image_of(rim).mean(axis=0)
        assert np.abs(seen - expected).max() < 0.03


def test_image_of_the_plate_has_x_to_the_right_and_y_up_and_nearer_things_are_larger() -> None:
    camera = studio().camera
    origin, right, up = camera.image_of(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    assert (right - origin)[0] > abs((right - origin)[1])
    assert (origin - up)[1] > abs((up - origin)[0])
    low, high = (np.linalg.norm(np.diff(camera.image_of(np.array([[0, 0, z], [1, 0, z]])), axis=0)) for z in (0, 6.5))
    assert 1.01 < high / low < 1.08


def test_written_video_has_every_frame_at_its_rate(tmp_path: Path) -> None:
    film, path = studio(), tmp_path / "r01.mp4"
    write_video(path, (film.image([Shape(disc(x, 0, 6.5, 1), (0, 0.5, 0))]) for x in range(4)), (320, 240), 30, 16)
    with av.open(str(path)) as container:
        times = [float(frame.time) for frame in container.decode(video=0)]
    assert np.allclose(times, np.arange(4) / 30)
