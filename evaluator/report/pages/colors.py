"""Colours of pages and figures, for a light and a dark page.

Those of Okabe and Ito (2008), distinguishable with every kind of colour vision.
"""

from __future__ import annotations

INK, SOFT, FAINT, PAPER = "#1b1f24", "#626a73", "#d9dde2", "#fefefe"
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#0072b2", "#d55e00", "#009e73", "#a8518a", "#e69f00", "#4a9fd0", "#b39700",
)  # fmt: skip

# Light colour: (CSS variable, colour in the dark).
THEME = {
    INK: ("--ink", "#e8eaed"),
    SOFT: ("--soft", "#a2a9b1"),
    FAINT: ("--faint", "#363c44"),
    PAPER: ("--paper", "#16191d"),
    BLUE: ("--blue", "#58b4e5"),
    VERMILLION: ("--vermillion", "#ff8a4c"),
    GREEN: ("--green", "#3cc9a0"),
    PURPLE: ("--purple", "#d99ac2"),
    ORANGE: ("--orange", "#f0b93c"),
    SKY: ("--sky", "#8fd0f2"),
    YELLOW: ("--yellow", "#e0c93a"),
}
