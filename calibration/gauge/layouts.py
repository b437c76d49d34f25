"""Dot grids by the names and counts that OpenCV and BoofCV use, as tables of gauge.toml.

| layout | of | columns, rows | pitch_mm |
|---|---|---|---|
| "symmetric" | OpenCV, CALIB_CB_SYMMETRIC_GRID | patternSize | squareSize: distance of neighbours |
| "asymmetric" | OpenCV, CALIB_CB_ASYMMETRIC_GRID | patternSize: 4, 11 | squareSize: half the distance in a row |
| "circle_grid" | BoofCV, CIRCLE_GRID | numCols, numRows | shapeDistance |
| "circle_hexagonal" | BoofCV, CIRCLE_HEXAGONAL | numCols, numRows | shapeDistance: of neighbours |

BoofCV counts rows from the bottom of the sheet, and the columns of a hexagonal grid twice as densely as its dots stand:
row r holds dots at the columns r mod 2, r mod 2 + 2, ….
"""

from __future__ import annotations

from typing import Any

SQUARE = ("symmetric", "circle_grid")
LAYOUTS = ("square", "staggered", *SQUARE, "asymmetric", "circle_hexagonal")


def named_layout(table: dict[str, Any]) -> dict[str, Any]:
    """The [dots] of gauge.toml with "square" or "staggered" for a layout of another library; others unchanged.

    Raises ValueError for a hexagonal grid with two pitches.
    """
    layout, pitch = table.get("layout"), table.get("pitch_mm")
    if layout in SQUARE:
        return table | {"layout": "square"}
    if layout == "asymmetric":
        step = pitch if isinstance(pitch, list | tuple) else (pitch, pitch)
        if len(step) == 2 and all(isinstance(value, int | float) for value in step):
            pitch = (2 * step[0], step[1])
        return table | {"layout": "staggered", "pitch_mm": pitch}
    if layout == "circle_hexagonal":
        return table | _hexagonal(table, pitch)
    return table


def _hexagonal(table: dict[str, Any], pitch: Any) -> dict[str, Any]:
    if isinstance(pitch, list | tuple):
        # pydantic turns a ValueError, and no TypeError, into its report
        raise ValueError(  # noqa: TRY004
            'a circle_hexagonal array has one pitch_mm, the distance of neighbouring dots; with two it is "staggered"'
        )
    columns, rows = table.get("columns"), table.get("rows")
    found: dict[str, Any] = {"layout": "staggered"}
    if isinstance(pitch, int | float):
        found["pitch_mm"] = (pitch, pitch * 0.75**0.5)
    if isinstance(columns, int) and isinstance(rows, int):
        # counted from the bottom, rows 1, 3, … are shifted: with an even count of rows the top one is
        found |= {
            "columns": (columns + 1) // 2,
            "shifted_rows": table.get("shifted_rows", "even" if rows % 2 == 0 else "odd"),
            "shifted_rows_shorter": columns % 2 == 1,
        }
    return found
