"""Fewer elements in a drawing of many points: a browser takes 20 µs an element before it shows the page.

matplotlib writes an element for each point and for each error bar. Neighbours that differ only in their place become
one path, drawn with the same marker or line: the drawing looks the same, above and below other elements as before.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import groupby

FEWEST = 100  # neighbours that become one element; drawings of less stay as matplotlib wrote them

POINT = re.compile(r'<use xlink:href="#(\w+)" x="([-\d.]+)" y="([-\d.]+)" style="([^"]*)"/>\n')
# Only lines: where areas or translucent lines overlap, one path looks different from two.
LINE = re.compile(r'<path d="([^"]*)"((?: clip-path="[^"]*")? style="fill: none;(?![^"]*opacity)[^"]*")/>\n')
OUTSIDE = re.compile(r'<path(?: clip-path="[^"]*")? style="[^"]*"/>\n')  # a line beyond the axes: nothing is drawn


def fewer_elements(svg: str) -> str:
    """The drawing with each series of points, and of lines of one style, as one path."""
    return _joined(_joined(OUTSIDE.sub("", svg), POINT, _points), LINE, _lines)


def _joined(svg: str, element: re.Pattern[str], join: Callable[[list[re.Match[str]]], str]) -> str:
    """The drawing with neighbours of the same kind joined."""
    pieces, written = [], 0
    for neighbours in _neighbours(list(element.finditer(svg))):
        if len(neighbours) >= FEWEST:
            pieces += [svg[written : neighbours[0].start()], join(neighbours)]
            written = neighbours[-1].end()
    return "".join((*pieces, svg[written:]))


def _neighbours(found: list[re.Match[str]]) -> list[list[re.Match[str]]]:
    """Groups of elements that follow each other immediately and differ only in their place."""
    group, numbers = 0, []
    for before, match in zip([None, *found], found, strict=False):
        group += before is None or before.end() != match.start() or _look(before) != _look(match)
        numbers.append(group)
    return [[match for _, match in several] for _, several in groupby(zip(numbers, found, strict=True), lambda x: x[0])]


def _look(match: re.Match[str]) -> tuple[str | None, ...]:
    """What elements that are joined have in common."""
    return (match[1], match[4]) if match.re is POINT else (match[2],)


def _points(points: list[re.Match[str]]) -> str:
    """A path without a line that has the marker at each of its points."""
    name, style = points[0][1], points[0][4]
    places = " ".join(f"{float(point[2]):.3f} {float(point[3]):.3f}" for point in points)
    ends = " ".join(f'marker-{part}="url(#{name}-{points[0].start()})"' for part in ("start", "mid", "end"))
    return (
        f'<marker id="{name}-{points[0].start()}" markerUnits="userSpaceOnUse" overflow="visible">'
        f'<use xlink:href="#{name}" style="{style}"/></marker>\n'
        f'<path d="M {places}" fill="none" stroke="none" {ends}/>\n'
    )


def _lines(lines: list[re.Match[str]]) -> str:
    """One path of all lines."""
    return f'<path d="{"".join(line[1] for line in lines)}"{lines[0][2]}/>\n'
