"""Drawings of many points: fewer elements, with the same points, lines and order."""

from __future__ import annotations

import re

from evaluator.report.fewer_elements import FEWEST, fewer_elements

STYLE = "fill: red; stroke: red"


def point(x: float, name: str = "m1", style: str = STYLE) -> str:
    """A point as matplotlib writes it."""
    return f'<use xlink:href="#{name}" x="{x:.6f}" y="2.500000" style="{style}"/>\n'


def line(x: float, style: str = "fill: none; stroke: red") -> str:
    """A line as matplotlib writes it."""
    return f'<path d="M {x} 0 \nL {x} 1 \n" clip-path="url(#c)" style="{style}"/>\n'


def many(element: str, *, fewer: int = 0) -> str:
    """Just as many neighbours as are joined, or fewer."""
    return element * (FEWEST - fewer)


def test_a_series_of_points_becomes_one_path_that_draws_the_marker_of_each() -> None:
    found = fewer_elements("<g>\n" + "".join(point(k) for k in range(FEWEST)) + "</g>\n")
    assert found.count("<use") == 1
    (name,) = re.findall(r'<marker id="([^"]*)" markerUnits="userSpaceOnUse" overflow="visible">', found)
    assert f'<use xlink:href="#m1" style="{STYLE}"/></marker>' in found
    (places, ends) = re.findall(r'<path d="M ([^"]*)" fill="none" stroke="none" ([^/]*)/>', found)[0]
    assert [float(x) for x in places.split()[::2]] == list(range(FEWEST))
    assert ends.split() == [f'marker-{part}="url(#{name})"' for part in ("start", "mid", "end")]


def test_lines_of_one_style_become_one_path_and_no_area_or_translucent_line_does() -> None:
    found = fewer_elements(many(line(1)) + many(line(2, "fill: none; stroke: blue")))
    assert found.count("<path") == 2
    assert found.count("M 1 0") == found.count("M 2 0") == FEWEST
    for style in ("fill: red", "fill: none; stroke: red; stroke-opacity: 0.4", "fill: none; opacity: 0.4"):
        assert fewer_elements(many(line(1, style))) == many(line(1, style))


def test_few_points_other_markers_and_elements_between_stay_as_they_are() -> None:
    for drawing in (
        many(point(1), fewer=1),
        (point(1) + point(1, "m2")) * FEWEST,
        (point(1) + point(1, style="fill: blue")) * FEWEST,
        (point(1) + "<g/>\n") * FEWEST,
    ):
        assert fewer_elements(drawing) == drawing


def test_lines_without_a_place_are_left_out() -> None:
    assert fewer_elements('<path clip-path="url(#c)" style="fill: none; stroke: red"/>\n' + line(1)) == line(1)


def test_what_is_above_stays_above() -> None:
    found = fewer_elements(many(point(1)) + '<path id="between"/>\n' + many(point(2)) + "<end/>")
    first, between, second = (found.index(part) for part in ("M 1.000", "between", "M 2.000"))
    assert first < between < second
    assert found.endswith("<end/>")
    assert len(set(re.findall(r'marker id="([^"]*)"', found))) == 2
