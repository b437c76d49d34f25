"""Which reading of a frame's colours is believed, and which shape: choices, with all that is measured made up."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.detection import appearance, explain, find
from evaluator.tracking.detection.explain import _refusal
from evaluator.tracking.refinement.disc import NO_SHADE
from evaluator.tracking.refinement.learn_shape import Patch, finished
from evaluator.tracking.settings import TrackingSettings


def believed(
    monkeypatch: pytest.MonkeyPatch, scores: dict[tuple[float, float], float], *, motley: bool = False,
    names: tuple[str, ...] = ("green", "yellow"), settings: TrackingSettings | None = None, seen: int = 2,
) -> tuple[Any, list[Any]]:  # fmt: skip
    """The reading, (balance, degrees by which hues are wider), that is believed, and all that were tried.

    scores: of the readings, -20 of others. seen: how many marks have a blob.
    """
    tried = []

    def candidates(_frame: Any, colors: Any, _settings: Any, _names: Any, wider: float = 0.0) -> list[Any]:
        tried.append((colors.balance, wider))
        return [tried[-1]]

    monkeypatch.setattr(find, "allowed_cells", lambda *_: np.ones(1, bool))
    monkeypatch.setattr(find, "color_map", lambda *at: SimpleNamespace(balance=(*at, 1.0)[2], motley=motley))
    monkeypatch.setattr(find, "_candidates", candidates)
    monkeypatch.setattr(
        find, "choose", lambda blobs, _: (dict.fromkeys(names[:seen], blobs[0]), scores.get(blobs[0], -20.0))
    )
    found: Any = find.find_marks(None, settings or TrackingSettings(), list(names))  # type: ignore[arg-type]
    assert found.balance == found.blobs[0][0]
    return found.blobs[0], tried


USUAL, PLAIN, WIDER, BOTH = (1.0, 0.0), (0.0, 0.0), (1.0, 15.0), (0.0, 15.0)


@pytest.mark.parametrize(
    ("scores", "reading"),
    [
        ({USUAL: -3.9, PLAIN: 0.0}, USUAL),  # good enough: nothing else is tried
        ({USUAL: -4.1, PLAIN: -2.0}, PLAIN),  # two less for the camera's own balance
        ({USUAL: -4.1, PLAIN: -2.2}, USUAL),
        ({USUAL: -7.0, PLAIN: -4.1}, USUAL),  # less than a good pair is no reason
        ({USUAL: -9.0, WIDER: -3.0, BOTH: -0.9}, BOTH),  # four less for wider hues, six for both
        ({USUAL: -9.0, WIDER: -3.0, BOTH: -1.1}, WIDER),
        ({USUAL: -9.0, PLAIN: -3.0, WIDER: -0.9}, WIDER),
        ({USUAL: -9.0, PLAIN: -3.0, WIDER: -1.1}, PLAIN),
        ({USUAL: -6.9, WIDER: -3.0}, USUAL),
        ({USUAL: -7.1, WIDER: -3.0}, WIDER),
    ],
)
def test_colours_are_read_in_an_unusual_way_where_that_gives_a_good_pair_against_its_odds(
    scores: dict[tuple[float, float], float], reading: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, tried = believed(monkeypatch, scores)
    assert found == reading
    assert len(tried) == (1 if scores[USUAL] > -4.0 else 4)


def test_the_cameras_own_balance_is_read_too_where_colours_are_motley_or_were_all_read_off_the_image(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    of_both = {USUAL: -3.0, PLAIN: -2.9}
    said = TrackingSettings.model_validate({"mark": {name: {"color": "#40c040"} for name in ("green", "yellow")}})
    one = TrackingSettings.model_validate({"mark": {"green": {"color": "#40c040"}, "yellow": {}}})
    assert believed(monkeypatch, of_both, motley=True)[0] == PLAIN
    assert believed(monkeypatch, of_both, settings=said)[0] == PLAIN
    assert believed(monkeypatch, of_both, settings=one)[0] == USUAL
    assert believed(monkeypatch, {USUAL: -2.8, PLAIN: -2.9}, motley=True)[0] == USUAL


def test_a_mark_that_is_not_seen_counts_as_thirty_and_one_mark_alone_is_read_as_usual(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert believed(monkeypatch, {USUAL: 27.0, PLAIN: 30.0}, seen=1)[0] == USUAL
    assert believed(monkeypatch, {USUAL: 24.0, PLAIN: 27.0}, seen=1)[0] == PLAIN
    assert believed(monkeypatch, {USUAL: -9.0, PLAIN: 0.0}, names=("green",)) == (USUAL, [USUAL])


def patch(samples: int = 40) -> Patch:
    return Patch(np.arange(float(samples)), np.zeros(samples), np.arange(float(samples)), (0.0, 0.0))


def learnt(
    monkeypatch: pytest.MonkeyPatch, patches: list[Patch], hidden: tuple[float, ...] = (), **values: float
) -> tuple[Any, list[list[int]]]:
    """The shape learnt, each time one px larger than before, and from how many samples of each patch.

    hidden: share of each patch that something lies across. values: of the shape.
    """
    lessons: list[list[int]] = []
    shape = {
        "radius_px": 10.0,
        "blur_px": 1.0,
        "amplitude": 50.0,
        "noise": 9.0,
        "edge": None,
        "occluded": 0.0,
        "shade": NO_SHADE,
        **values,
    }

    def learn(given: list[Patch], _radius: float, _blur: float, *, shaded: bool) -> Iterator[None]:
        assert shaded  # a flat one is tried only if a shade was found
        lessons.append([len(one.value) for one in given])
        yield
        return Shape(**{**shape, "radius_px": shape["radius_px"] + len(lessons) - 1})  # type: ignore[return-value]

    shares = iter(hidden)
    monkeypatch.setattr(appearance, "learn_disc", learn)
    monkeypatch.setattr(appearance, "replace", lambda disc, **new: Shape(**{**vars(disc), **new}))
    monkeypatch.setattr(appearance, "_uncovered", lambda one, _: (one.value < 35.0, next(shares)))
    return finished(appearance.learn_shape(patches, 10.0, smeared=True)), lessons


class Shape(SimpleNamespace):
    """Stands for a disc."""


@pytest.mark.parametrize(
    ("values", "is_one"),
    [
        ({"radius_px": 4.1}, True),
        ({"radius_px": 3.9}, False),
        ({"radius_px": 19.0}, True),
        ({"radius_px": 21.0}, False),
        ({"amplitude": -6.1}, True),  # of a noise of three levels
        ({"amplitude": 5.9}, False),
    ],
)
def test_a_shape_is_a_disc_of_about_the_size_that_was_seen_and_stands_out_of_the_noise(
    values: dict[str, float], is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (learnt(monkeypatch, [patch()] * 2, **values)[0] is not None) == is_one


def test_a_shape_is_learnt_from_patches_of_thirty_samples_and_a_thousand_of_larger_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert learnt(monkeypatch, [patch(30)])[0] is None
    assert learnt(monkeypatch, [patch(31), patch(1009), patch(5000)][:2])[1] == [[31, 1009]]
    assert learnt(monkeypatch, [patch(5000)])[1] == [[1009]]
    thin = appearance._thinned(patch(5000))
    assert (thin.x[0], thin.x[-1]) == (0.0, 4999.0)


@pytest.mark.parametrize(
    ("hidden", "lessons", "occluded"),
    [
        ((0.0,) * 3, 1, 0.0),  # nothing lies across it
        ((0.3, 0.0, 0.0, *(0.0,) * 3), 2, 0.1),  # learnt anew without what did, once nothing does
        ((0.3, 0.0, 0.0, 0.6, 0.0, 0.0, 0.9, 0.0, 0.0), 4, 0.3),  # three times at most
        ((0.6, 0.6, 0.4), 1, 0.0),  # so much that it is no disc at all
        ((0.3, 0.0, 0.0, 0.6, 0.6, 0.6), 2, 0.0),
    ],
)
def test_a_shape_is_learnt_anew_without_what_lies_across_it(
    hidden: tuple[float, ...], lessons: int, occluded: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    disc, given = learnt(monkeypatch, [patch()] * 3, hidden)
    assert given == [[40] * 3, *[[35] * 3] * (lessons - 1)]
    assert disc.occluded == pytest.approx(occluded)
    assert disc.radius_px == (10.0 if occluded == 0.0 else 9.0 + lessons)


@pytest.mark.parametrize(
    ("blob", "said", "reason"),
    [
        ({}, {}, "another is likelier"),
        ({}, {"allowed": False}, "outside region_px"),
        ({"hue": 101.0}, {}, "hue 101 deg is not within 60 to 100"),
        ({"hue": 59.0}, {}, "hue 59 deg is not within"),
        ({"hue": 5.0}, {"wanted": (350.0, 10.0)}, "another is likelier"),  # across red
        ({"hue": 12.0}, {"wanted": (350.0, 10.0)}, "hue 12 deg is not within 350 to 10"),
        ({"chroma": 39.0}, {}, "too pale: chroma 39, the frame's own tints reach 40"),
        ({"radius_px": 2.9}, {"diameter_px": 10.0}, "6 px across is not about diameter_px = 10"),
        ({"radius_px": 8.6}, {"diameter_px": 10.0}, "17 px across is not about"),
        ({"radius_px": 8.4}, {"diameter_px": 10.0}, "another is likelier"),
        ({"elongation": 6.1}, {}, "a stripe: 6.1 times as long as wide"),
        ({"whole": False}, {}, "cut by the border of the image"),
    ],
)
def test_a_blob_is_refused_with_the_number_and_the_setting_that_would_change_it(
    blob: dict[str, Any], said: dict[str, Any], reason: str
) -> None:
    usual = {"hue": 80.0, "radius_px": 5.0, "elongation": 1.1, "chroma": 41.0, "whole": True} | blob
    hue = usual.pop("hue")
    options: Any = {"wanted": (60.0, 100.0), "diameter_px": None, "allowed": True} | said
    one: Any = SimpleNamespace(**usual)
    found = _refusal(one, hue, options["wanted"], 40.0, options["diameter_px"], allowed=options["allowed"])
    assert found.startswith(reason)


@pytest.mark.parametrize(("column", "row"), [(0.5, 5.0), (5.0, 9.9), (10.5, 5.0)])
def test_a_search_tells_of_each_blob_its_hue_and_whether_it_was_sought_there(
    column: float, row: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells of 2 px from (0.5, 0.5) on, coloured alike, of which the left half is searched."""
    hue = np.full((10, 11), np.nan, np.float32)
    hue[:, :] = 80.0
    monkeypatch.setattr(explain, "allowed_cells", lambda *_: np.tile(np.arange(11) < 6, (10, 1)))
    monkeypatch.setattr(explain, "blobs_of", lambda *_: [])  # none of the mark's own hue
    colors: Any = SimpleNamespace(chroma=np.full((10, 11), 50.0), floor=40.0, cell_px=(2.0, 2.0), origin_px=(0.5, 0.5))
    place = 0.5 + 2 * (column - 0.5), 0.5 + 2 * (row - 0.5)
    blob: Any = SimpleNamespace(center_px=place, radius_px=3.0, elongation=1.0, chroma=50.0, whole=True)
    settings = TrackingSettings.model_validate({"mark": {"green": {"hue_deg": [60, 100]}}})
    seen = explain._of_mark("green", None, settings, colors, hue.ravel(), [blob], None)  # type: ignore[arg-type]
    (found,) = seen.blobs
    assert found.hue_deg == pytest.approx(80.0)
    assert found.verdict.startswith("another is likelier" if column < 6 else "outside region_px")
    assert seen.mask.sum() == 60
    chosen = explain._of_mark("green", None, settings, colors, hue.ravel(), [blob], blob)  # type: ignore[arg-type]
    assert (chosen.blobs[0].verdict, chosen.blobs[0].chosen) == ("chosen", True)


def test_of_a_marks_own_hue_the_four_largest_that_are_no_blob_by_themselves_are_told_first() -> None:
    """And eight blobs in all. A mark that touches something of another hue is a part of one blob with that."""

    def blob(place: float, radius: float) -> Any:
        return SimpleNamespace(center_px=(place, 0.0), radius_px=radius)

    own = [blob(1000.0 + 50.0 * k, radius) for k, radius in enumerate((3.0, 5.0, 4.0, 9.0, 6.0))]
    others = [blob(50.0 * k, 5.0) for k in range(7)]
    assert explain._with_own(others, own) == [own[k] for k in (3, 4, 1, 2)] + others[:4]
    assert explain._with_own([own[3], *others], own) == [own[k] for k in (4, 1, 2)] + [own[3], *others[:4]]
    assert explain._with_own(others, []) == others


def colored(blobs: list[tuple[int, int, int, float, float]], rows: int = 40, columns: int = 60) -> Any:
    """Colours of a frame that is grey but for squares: row, column, side, hue and chroma."""
    chroma, hue = np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.float32)
    for row, column, side, angle, strength in blobs:
        part = slice(row, row + side), slice(column, column + side)
        chroma[part], hue[part] = strength, angle
    cells = np.flatnonzero(chroma > 20.0)
    return SimpleNamespace(
        chroma=chroma, floor=20.0, colorful=cells, hue_deg=hue.ravel()[cells], u=chroma, v=chroma,
        cell_px=(1.0, 1.0), origin_px=(0.0, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("hues", "wider", "found"),
    [
        ((60.0, 100.0), 0.0, [(7.5, 7.5), (17.5, 7.5)]),  # of 65 and 95 degrees
        ((350.0, 66.0), 0.0, [(7.5, 7.5), (37.5, 7.5), (47.5, 7.5)]),  # across red: 355 and 5, too
        ((66.0, 90.0), 9.0, []),  # what a user says is not widened
    ],
)
def test_blobs_of_a_mark_are_those_of_its_hues_around_the_circle(
    hues: tuple[float, float], wider: float, found: list[tuple[float, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(find, "allowed_cells", lambda *_: np.ones((40, 60), bool))
    squares = [(5, 5, 6, 65.0, 60.0), (5, 15, 6, 95.0, 60.0), (5, 35, 6, 355.0, 60.0), (5, 45, 6, 5.0, 60.0)]
    settings = TrackingSettings.model_validate({"mark": {"green": {"hue_deg": hues}}})
    seen = find._candidates(None, colored(squares), settings, ["green"], wider)  # type: ignore[arg-type]
    assert sorted(one.center_px for one in seen) == found


def test_a_mark_on_something_of_its_own_hue_stands_out_at_a_level_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """A square of 6 on one of 24, twice as colourful, and one that is hardly more colourful than a level."""
    monkeypatch.setattr(find, "allowed_cells", lambda *_: np.arange(2400).reshape(40, 60) % 60 < 50)
    settings = TrackingSettings.model_validate({"mark": {"green": {"hue_deg": (60.0, 100.0)}}})
    for strength, sizes in ((95.0, [6, 24]), (46.5, [6, 24]), (45.5, [24])):
        squares = [(5, 5, 24, 80.0, 39.0), (12, 9, 6, 80.0, strength), (5, 52, 6, 80.0, 90.0)]
        seen = find._candidates(None, colored(squares), settings, ["green"])  # type: ignore[arg-type]
        assert sorted(round(one.radius_px * np.pi**0.5) for one in seen) == sizes  # and none beyond column 50
        small = min(seen, key=lambda one: one.radius_px)
        assert small.center_px == ((11.5, 14.5) if len(sizes) > 1 else pytest.approx((16.5, 16.5), abs=0.2))


def test_eight_blobs_are_explained_the_most_colourful_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chroma times the radius, up to ten: a large faint thing counts no more than a mark."""
    monkeypatch.setattr(explain, "allowed_cells", lambda *_: np.ones((40, 60), bool))
    squares = [(2, 2 + 6 * k, 4, 80.0, 30.0 + k) for k in range(9)] + [(12, 2, 24, 80.0, 29.0)]
    monkeypatch.setattr(explain, "color_map", lambda *_, **__: colored(squares))
    monkeypatch.setattr(explain, "find_marks", lambda *_: SimpleNamespace(chosen={}))
    frame: Any = SimpleNamespace(u=np.zeros((40, 60)))
    settings = TrackingSettings.model_validate({"mark": {"green": {"hue_deg": (60.0, 100.0)}}})
    (seen,) = explain.explain(frame, settings)
    assert [round(one.blob.chroma) for one in seen.blobs] == [29, *range(38, 31, -1)]


def test_twelve_blobs_of_a_mark_are_examined_the_most_colourful_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(find, "allowed_cells", lambda *_: np.ones((40, 60), bool))
    settings = TrackingSettings.model_validate({"mark": {"green": {"hue_deg": (60.0, 100.0)}}})
    squares = [(2 + 12 * (k // 5), 2 + 12 * (k % 5), 6, 80.0, 30.0 + k % 7 + 0.1 * k) for k in range(15)]
    seen = find._candidates(None, colored(squares), settings, ["green"])  # type: ignore[arg-type]
    assert [one.chroma for one in seen] == pytest.approx(sorted((square[-1] for square in squares), reverse=True)[:12])
