"""How good is the calibration? Images drawn exactly by random cameras; the truth is known.

python -m tests.benchmarks.calibration centers     dot centres against the Cramér-Rao bound, and their bias
python -m tests.benchmarks.calibration plane       plane at mark height from 7 images of a 17 × 13 gauge
python -m tests.benchmarks.calibration coverage    do 95 % intervals cover 95 % of the truth? (--cameras 300)
python -m tests.benchmarks.calibration bent        a gauge that is not flat, solved as flat and with its face
python -m tests.benchmarks.calibration opencv      side by side with findCirclesGrid + calibrateCamera
python -m tests.benchmarks.calibration grids       whole grids found, few large dots too, beside findCirclesGrid
python -m tests.benchmarks.calibration speed       time of detection and assignment
python -m tests.benchmarks.calibration straight    straightness of a real image's lines after correction (PICTURE)
"""

from __future__ import annotations

import click

from tests.benchmarks.calibration.bent import bent
from tests.benchmarks.calibration.centers import centers
from tests.benchmarks.calibration.grids import grids
from tests.benchmarks.calibration.opencv import opencv
from tests.benchmarks.calibration.plane import coverage, plane
from tests.benchmarks.calibration.speed import speed
from tests.benchmarks.calibration.straight import straight


@click.group()
def main() -> None:
    """Benchmarks of the calibration."""


for command in (centers, plane, coverage, bent, opencv, grids, speed, straight):
    main.add_command(command)

if __name__ == "__main__":
    main()
