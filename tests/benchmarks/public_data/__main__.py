"""Public data as an exam: published truth, threshold and centroid, and OpenCV beside turnscope.

    python -m tests.benchmarks.public_data FOLDER [grids] [cameras] [tags] [marks] [car]

FOLDER holds clones of the repositories that `sets.py` lists, as OWNER/NAME, OWNER+NAME or NAME; sets that are not there
are named and left out. Nothing of them is part of this project. Times of grids and tags are of the processor.
"""

from __future__ import annotations

from pathlib import Path

import click

from tests.benchmarks.public_data.grids import cameras, grids
from tests.benchmarks.public_data.marks import marks
from tests.benchmarks.public_data.sets import CAR
from tests.benchmarks.public_data.tags import tags
from tests.benchmarks.turning import real_table


def car(folder: Path) -> None:
    """Radius against speed; the published kinematic radius is 0.54 m."""
    print("\ncar on a circle: published 0.577 m at 1.3 m/s to 1.05 m at 2.7 m/s (rubber)")
    place = CAR.find(folder)
    if place is None:
        print(CAR.reason)
    else:
        real_table(place.parent)


PARTS = {"grids": grids, "cameras": cameras, "tags": tags, "marks": marks, "car": car}


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("parts", nargs=-1, type=click.Choice(tuple(PARTS)))
def main(folder: Path, parts: tuple[str, ...]) -> None:
    for part in parts or tuple(PARTS):
        PARTS[part](folder)


if __name__ == "__main__":
    main()
