"""Images of dot grids with known centres, drawn with numpy and OpenCV alone: nothing of the product draws or projects.

A sheet in plane units (one unit: the distance of neighbouring dots) is seen through a homography, 4 × 4 samples a
pixel; then blur, clutter, glare, vignetting, noise and JPEG. Image frame: x right, y down, centre of the top left pixel
(0, 0).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Layout = Literal["symmetric", "asymmetric", "hexagonal"]
SAMPLES = 4  # a pixel side
KINDS = ("few large", "tilted", "thermal", "light on dark", "clutter", "texture", "glare", "small image",
         "asymmetric", "hexagonal", "dense")  # fmt: skip


@dataclass(frozen=True)
class GridImage:
    """An image (h, w) or (h, w, 3), uint8, of one grid.

    places: (n, 2) of the dots on the sheet, x right and y down. centers_px: (n, 2) of their images (of the ellipse, not
    of the disc's centre), NaN where the dot is not wholly in view. clear: (n,) whether it is in view with its blurred
    edge, so that it must be found. size: (columns, rows) as OpenCV counts them.
    bright: whether dots are brighter than the sheet. diameter: in units of `places`.
    """

    kind: str
    image: NDArray[np.uint8]
    places: Array
    centers_px: Array
    clear: NDArray[np.bool_]
    layout: Layout
    size: tuple[int, int]
    bright: bool
    diameter: float


def grid_places(layout: Layout, size: tuple[int, int]) -> Array:
    """Dots of a grid, row by row, one unit to the nearest neighbour (asymmetric: OpenCV's, hexagonal: BoofCV's)."""
    columns, rows = size
    if layout == "symmetric":
        return np.array([(x, y) for y in range(rows) for x in range(columns)], dtype=float)
    if layout == "asymmetric":  # OpenCV: x = (2 column + row mod 2) s, y = row s
        return np.array([(2 * x + y % 2, y) for y in range(rows) for x in range(columns)], dtype=float) / np.sqrt(2)
    # BoofCV: rows counted from the bottom; row r holds every second column from r mod 2 on
    step = np.sqrt(3) / 2
    return np.array([(0.5 * x, step * (rows - 1 - y)) for y in range(rows) for x in range(y % 2, columns, 2)])


def draw_grid(
    kind: str,
    rng: np.random.Generator,
    *,
    layout: Layout = "symmetric",
    size: tuple[int, int] = (4, 3),
    size_px: tuple[int, int] = (640, 480),
    diameter: float = 0.5,
    fill: tuple[float, float] = (0.6, 0.85),
    tilt_deg: float = 20.0,
    blur_px: float = 1.0,
    levels: tuple[float, float] = (40.0, 210.0),
    noise: float = 3.0,
    vignetting: float = 0.15,
    glare: int = 0,
    clutter: int = 0,
    texture: float = 0.0,
    jpeg: int | None = 85,
    margin: float = 0.9,
) -> GridImage:
    """Draw one grid in a random pose.

    fill: share of the image that the grid spans. tilt_deg: largest tilt. blur_px: normal. levels: of dots and sheet.
    glare: count of highlights. clutter: count of circles beside the sheet. texture: amplitude of the surroundings.
    margin: of the sheet around the dots' centres, in units.
    """
    places = grid_places(layout, size)
    matrix = _pose(places, rng, size_px, rng.uniform(*fill), tilt_deg)
    width, height = size_px
    x, y = ((np.arange(SAMPLES * count) + 0.5) / SAMPLES - 0.5 for count in size_px)
    y = y[:, None]
    inverse = np.linalg.inv(matrix)
    depth = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
    u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / depth
    v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / depth
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    sheet = (depth > 0) & (u > low[0]) & (u < high[0]) & (v > low[1]) & (v < high[1])
    ground = 0.5 * (levels[0] + levels[1]) + _texture(depth.shape, rng, texture)
    picture = np.where(sheet, levels[1], ground)
    for place in places:
        part = _samples_of(place, diameter / 2, matrix, size_px)
        inside = (u[part] - place[0]) ** 2 + (v[part] - place[1]) ** 2 < diameter**2 / 4
        picture[part][sheet[part] & inside] = levels[0]
    for _ in range(clutter):
        _add_circle(picture, ~sheet, rng)
    picture = picture.reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    picture = cv2.GaussianBlur(picture, (0, 0), blur_px)
    y, x = np.mgrid[:height, :width]
    off = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / (width**2 / 4 + height**2 / 4)
    picture *= 1 - vignetting * off
    for _ in range(glare):
        at, wide = rng.uniform(0.2, 0.8, 2) * size_px, rng.uniform(0.03, 0.08) * width
        picture += 150 * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * wide**2))
    image = np.clip(np.rint(picture + rng.normal(0, noise, picture.shape)), 0, 255).astype(np.uint8)
    if jpeg is not None:
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, jpeg])[1], cv2.IMREAD_GRAYSCALE)
    centers = _ellipse_centers(places, matrix, diameter / 2, size_px, 0.0)
    clear = np.isfinite(_ellipse_centers(places, matrix, diameter / 2, size_px, 2 + 4 * blur_px)).all(axis=1)
    return GridImage(kind, image, places, centers, clear, layout, size, levels[0] > levels[1], diameter)


def _pose(places: Array, rng: np.random.Generator, size_px: tuple[int, int], fill: float, tilt_deg: float) -> Array:
    """Homography (3, 3) from the sheet to the image: a pinhole of 1.2 widths, tilted and turned at random."""
    middle, span = (places.min(axis=0) + places.max(axis=0)) / 2, np.ptp(places, axis=0) + 1
    tilt, azimuth, turn = np.radians([tilt_deg * rng.uniform(0.2, 1), rng.uniform(0, 360), rng.uniform(-20, 20)])
    rotation = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))[0]
    rotation = cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0] @ rotation
    focal = 1.2 * size_px[0]
    distance = focal / (fill * float((np.array(size_px) / span).min()))
    shift = np.array([*(0.04 * rng.uniform(-1, 1, 2) * distance), distance])
    camera = np.array([[focal, 0, (size_px[0] - 1) / 2], [0, focal, (size_px[1] - 1) / 2], [0, 0, 1]])
    to_middle = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1]])
    return np.asarray(camera @ np.column_stack([rotation[:, 0], rotation[:, 1], shift]) @ to_middle)


def _samples_of(place: Array, radius: float, matrix: Array, size_px: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of samples that hold the image of a disc, all of them where it reaches behind the camera."""
    corners = place + radius * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    seen = np.column_stack([corners, np.ones(4)]) @ matrix.T
    if (seen[:, 2] <= 0).any():
        return slice(None), slice(None)
    at = seen[:, :2] / seen[:, 2:]
    low = np.clip(np.floor(at.min(axis=0)), 0, size_px).astype(int) * SAMPLES
    high = np.clip(np.ceil(at.max(axis=0)) + 2, 0, size_px).astype(int) * SAMPLES
    return slice(low[1], high[1]), slice(low[0], high[0])


def _ellipse_centers(places: Array, matrix: Array, radius: float, size_px: tuple[int, int], rim_px: float) -> Array:
    """Centres (n, 2) of the images of discs, from their dual conics; NaN within rim_px of the edge of the image."""
    found = []
    for x, y in places:
        to_disc = np.array([[radius, 0, x], [0, radius, y], [0, 0, 1]])
        dual = matrix @ to_disc @ np.diag([1.0, 1.0, -1.0]) @ to_disc.T @ matrix.T
        center = dual[:2, 2] / dual[2, 2]
        reach = np.sqrt(np.maximum(center**2 - np.diag(dual)[:2] / dual[2, 2], 0))
        inside = (center - reach > rim_px).all() and (center + reach < np.array(size_px) - 1 - rim_px).all()
        found.append(center if inside else np.full(2, np.nan))
    return np.array(found)


def _texture(shape: tuple[int, ...], rng: np.random.Generator, amplitude: float) -> Array | float:
    """Surroundings with structure at several scales."""
    if amplitude == 0:
        return 0.0
    total = np.zeros(shape, dtype=np.float32)
    for step in (8, 24, 80, 240):
        coarse = rng.normal(0, 1, (shape[0] // step + 2, shape[1] // step + 2)).astype(np.float32)
        total += cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return amplitude * np.asarray(total, dtype=float)


def _add_circle(image: Array, free: NDArray[np.bool_], rng: np.random.Generator) -> None:
    """Draw a circle of any level where `free` allows it."""
    height, width = image.shape
    x, y, radius = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0.01, 0.05) * width
    left, right = int(max(x - radius, 0)), int(min(x + radius + 2, width))
    top, bottom = int(max(y - radius, 0)), int(min(y + radius + 2, height))
    j, i = np.mgrid[top:bottom, left:right]
    inside = ((i - x) ** 2 + (j - y) ** 2 < radius**2) & free[top:bottom, left:right]
    image[top:bottom, left:right][inside] = rng.uniform(20, 235)


def loose_circles(
    rng: np.random.Generator, count: int = 12, size_px: tuple[int, int] = (640, 480)
) -> NDArray[np.uint8]:
    """An image of large, clear circles that form no grid and do not touch."""
    width, height = size_px
    image = np.full((height, width), 210, np.uint8)
    placed: list[tuple[float, float, float]] = []
    while len(placed) < count:
        radius = rng.uniform(0.02, 0.08) * width
        x, y = rng.uniform(radius, width - radius), rng.uniform(radius, height - radius)
        if all(np.hypot(x - a, y - b) > radius + r + 4 for a, b, r in placed):
            placed.append((x, y, radius))
            cv2.circle(image, (int(16 * x), int(16 * y)), int(16 * radius), 40, -1, cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.uint8)


def grid_images(kind: str, count: int, seed: int = 0) -> Iterator[GridImage]:
    """Images of one of KINDS; a seed and a kind give the same images again."""
    for number in range(count):
        rng = np.random.default_rng([seed, KINDS.index(kind), number])
        size = [(4, 3), (5, 4), (6, 5), (7, 4), (3, 4)][number % 5]
        drawn: dict[str, Any] = {"size": size, "diameter": rng.uniform(0.35, 0.7)} | _settings(kind, rng)
        yield draw_grid(kind, rng, **drawn)


def _settings(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """What draws one of KINDS."""
    if kind == "thermal":
        levels = tuple(rng.permutation([100.0, 145.0]))
        soft = {"blur_px": rng.uniform(3, 7), "levels": levels, "noise": rng.uniform(2, 6)}
        return soft | {"vignetting": 0.3, "texture": 4.0, "clutter": 2}
    return {
        "few large": {},
        "tilted": {"tilt_deg": 50.0, "fill": (0.7, 0.95)},
        "light on dark": {"levels": (225.0, 50.0), "noise": 4.0},
        "clutter": {"fill": (0.4, 0.6), "clutter": 12, "texture": 10.0, "margin": 0.6},
        "texture": {"fill": (0.4, 0.6), "texture": 35.0},
        "glare": {"glare": 3, "vignetting": 0.4, "noise": 5.0},
        "small image": {"size_px": (160, 120), "blur_px": 1.0, "noise": 4.0, "jpeg": 70},
        "asymmetric": {"layout": "asymmetric", "size": (4, 11), "tilt_deg": 35.0},
        "hexagonal": {"layout": "hexagonal", "size": (14, 24), "tilt_deg": 30.0},
        "dense": {"size": (17, 13), "tilt_deg": 30.0, "fill": (0.8, 1.1)},
    }[kind]
