"""The public sets: where they were published, under which licence, where they lie in a folder, and what is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.calibration.grid_images import Layout


@dataclass(frozen=True)
class Published:
    """Where a set comes from: repository at github.com, licence, path in the repository, path in other collections."""

    name: str
    repository: str
    licence: str
    path: str
    elsewhere: str = ""

    def find(self, folder: Path) -> Path | None:
        """Where the set lies in a folder, as OWNER/NAME/path, OWNER+NAME/path, NAME/path or elsewhere; None if not."""
        owner, name = self.repository.split("/")
        roots = (f"{owner}/{name}", f"{owner}+{name}", name)
        places = [folder / root / self.path for root in roots] + ([folder / self.elsewhere] if self.elsewhere else [])
        return next((place for place in places if place.exists()), None)

    @property
    def reason(self) -> str:
        """Say that the set is not there, and where to get it."""
        return f"{self.name}: left out, not in the folder; github.com/{self.repository}, {self.path} ({self.licence})"


@dataclass(frozen=True)
class GridSet:
    """Photographs of a grid: those that a pattern names, columns and rows as OpenCV or BoofCV count them, diameter over
    distance of the dots. calibrates: whether the images show one grid to one camera from several sides. dots: in each
    image, where the grid is larger than the image; 0: unknown.
    """

    published: Published
    pattern: str
    layout: Layout = "symmetric"
    columns: int = 0
    rows: int = 0
    diameter: float = 0.5
    calibrates: bool = True
    dots: int = 0


CALIBRATION_API = "Abhijit-2592/camera_calibration_API"
BOOFCV = "lessthanoptimal/BoofCV-Data"
VISP = "lagadic/visp-images"
DISCORPY = "DiamondLightSource/discorpy"
PHOTOGRAPHS = "example/calibration/mono/Sony_DSC-HX5V_"

GRIDS = (
    GridSet(
        Published("symmetric 6 x 5, glare", CALIBRATION_API, "Apache-2.0", "examples/example_images/symmetric_grid",
                  "dot_grids/symmetric_grid"), "*.png", columns=6, rows=5, diameter=0.6,
    ),
    GridSet(
        Published("asymmetric 4 x 11", CALIBRATION_API, "Apache-2.0", "examples/example_images/asymmetric_grid",
                  "dot_grids/asymmetric_grid"), "*.png", "asymmetric", 4, 11, 0.7,
    ),
    GridSet(
        Published("symmetric 10 x 8, shadow", BOOFCV, "CC-BY-4.0", PHOTOGRAPHS + "CircleRegular"),
        "*.jpg", columns=10, rows=8, diameter=0.6,
    ),
    GridSet(
        Published("hexagonal 28 x 24", BOOFCV, "CC-BY-4.0", PHOTOGRAPHS + "CircleHexagonal"),
        "*.jpg", "hexagonal", 28, 24, 1 / 1.2,
    ),
    GridSet(
        Published("symmetric 6 x 6", VISP, "GPL-2.0", "calibration"),
        "grid36-*.png", columns=6, rows=6, diameter=0.6,
    ),
    *(
        GridSet(
            Published(f"dense array {number}", DISCORPY, "Apache-2.0", "data", "dot_arrays"),
            f"dot_pattern_{number}.jpg", calibrates=False, dots=dots,
        )
        for number, dots in (("01", 6368), ("02", 1305), ("03", 0), ("04", 0), ("05", 0), ("06", 0))
    ),
)  # fmt: skip

TAGS = Published("AprilTags, drawn", VISP, "GPL-2.0", "AprilTag/benchmark/640x480")
FIELD = Published(
    "robot-soccer field", "VSS-SDK/VSS-Vision", "GPL-3.0", "mock/videos/robot_move.mp4",
    "robots_from_above/robot_move.mp4",
)  # fmt: skip
BALL = Published("green ball", "trflorian/ball-tracking-live-plot", "MIT", "data/ball.mp4", "green_ball/ball.mp4")
HELD = tuple(
    Published(f"hand-held ball {number}", "trflorian/ball-tracking-live-plot", "MIT", f"media/ball{number}.mp4")
    for number in (2, 3, 4)
)
PENDULUM = Published("pendulum", "juangomez177/Pendulum_Oscillatory_Motion", "none stated", "pendulum.mp4")
SQUARES = tuple(
    Published(f"halves of squares {number}", "RoBorregos/VSSS-2019-legacy", "none stated", f"vision/media/{name}.mp4")
    for number, name in enumerate(("test", "test2"), start=1)
)
CAR = Published("car on a circle", "Lorenzo-Lyons/DART", "MIT", "rc_car_circles", "rc_car_circles")
