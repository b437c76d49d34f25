"""The choice of a lens and of faces, and what is refused of images: each limit from either side."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.assignment.gauge_in_image import FEWEST_DOTS
from calibration.camera import PARAMETERS
from calibration.errors import CalibrationError, ImageError
from calibration.estimation import model_choice
from calibration.estimation.bundle_adjustment import (
    LENS_PARAMETERS,
    solve,
    view_rows,
)
from calibration.estimation.calibrate import Faults, _check_left_out, _check_pitch
from calibration.estimation.gauge_as_printed import _faces
from calibration.estimation.model_choice import Trial, _every, _fold, _held_out, choose_model, focal_of_lens_models
from calibration.estimation.robust import robust_scale
from tests.calibration.bundles import CAMERA, GAUGE, LOOSE, bundle
from tests.calibration.drawing import gauge_of


def test_blocks_of_neighbours_are_held_out_each_dot_once() -> None:
    (view,), _ = bundle(1)
    fold = _fold(view)
    assert set(fold) == {0, 1, 2, 3}
    assert np.bincount(fold).min() > 88 / 4 / 2
    places = view.points_mm[:, :2]
    beside = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    alike = fold[:, None] == fold[None]
    assert alike[(beside > 0) & (beside < 3.1)].mean() > 0.3  # a quarter would be by chance


def test_error_of_dots_held_out_is_that_of_a_fit_without_them() -> None:
    views, state = bundle(2, noise_px=0.02)
    fit = solve(views, state, LOOSE)
    squares = []
    for fold in range(4):
        held = [_fold(view) == fold for view in views]
        rest = solve([view.take(~part) for view, part in zip(views, held, strict=True)], fit.state, LOOSE)
        for k, (view, part) in enumerate(zip(views, held, strict=True)):
            squares.append(np.sum(view_rows(view, rest.state, k)[1][part] ** 2, axis=1))
    assert _held_out(views, fit) == pytest.approx(np.mean(np.concatenate(squares)), rel=0.02)


def test_a_dot_that_contradicts_all_others_counts_as_much_as_five_usual_residuals() -> None:
    views, state = bundle(2, noise_px=0.02)
    usual = _held_out(views, solve(views, state, LOOSE))
    views[1].centers_px[40] += [3.0, -2.0]  # 180 sigmas
    fit = solve(views, state, LOOSE)
    cap = (5.0 * robust_scale(fit.whitened)) ** 2
    assert 176 * (_held_out(views, fit) - usual) == pytest.approx(cap - 2.0, abs=3.0)  # 2: its own share before


def trial(focal_px: float, sigma_px: float, held_out: float, *, terms: int = 4, face: int = 0) -> Trial:
    """A model of so many free terms, of which the focal length is known to sigma_px."""
    lens = np.array([focal_px, *np.zeros(9)])
    fit: Any = SimpleNamespace(state=SimpleNamespace(lens=lens), variance=4.0, normal=np.diag([4.0 / sigma_px**2, 1.0]))
    return Trial("brown", ("focal_px", *"abcdefgh"[: terms - 1]), fit, held_out, face)


@pytest.mark.parametrize(
    ("others", "expected_px"),
    [
        ([], 0.0),
        ([trial(1010.0, 3.0, 1.1)], 10.0),  # as sure, elsewhere
        ([trial(1000.0, 5.0, 1.1)], 4.0),  # less sure, in the same place: variances of 25 and 9
        ([trial(1010.0, 5.0, 1.1), trial(1002.0, 3.0, 1.05)], 116**0.5),
        ([trial(1010.0, 5.0, 1.33)], 0.0),  # worse than four terms are by chance, each 2 · 4 / 100
        ([trial(1010.0, 5.0, 1.33, terms=5)], 116**0.5),
        ([trial(1010.0, 5.0, 1.1, face=3)], 0.0),  # of another gauge
        ([trial(1000.0, 2.0, 1.1)], 0.0),
    ],
)
def test_what_lens_models_disagree_about_is_not_known_of_the_focal_length(
    others: list[Trial], expected_px: float
) -> None:
    view: Any = range(100)
    found = focal_of_lens_models([trial(1000.0, 3.0, 1.0), *others], [view])
    assert found == pytest.approx(expected_px / 1000, abs=1e-9)


@pytest.mark.parametrize(("dots", "kept"), [(3000, 3000), (4000, 2000), (6100, 2034)])
def test_two_thousand_dots_decide_on_a_lens(dots: int, kept: int) -> None:
    views: list[Any] = [range(dots)]
    assert _every(views[0], views).sum() == kept


def test_the_simplest_lens_is_chosen_that_predicts_as_well_as_the_best_to_two_variances(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fit: Any = SimpleNamespace(variance=1.5)
    views: list[Any] = [SimpleNamespace(take=lambda _: [0] * 100, __len__=lambda: 100)]
    monkeypatch.setattr(model_choice, "_every", lambda *_: None)

    def chosen(*trials: tuple[str, int, float]) -> tuple[str, int]:
        found = [Trial(model, ("k",) * terms, fit, held_out) for model, terms, held_out in trials]  # type: ignore[arg-type]
        monkeypatch.setattr(model_choice, "_trials", lambda *_: found)
        best = choose_model(views, [], LOOSE)[0]
        return best.model, len(best.free)

    assert chosen(("brown", 3, 2.029), ("brown", 5, 2.0)) == ("brown", 3)  # 2 · 1.5 / 100
    assert chosen(("brown", 3, 2.031), ("brown", 5, 2.0)) == ("brown", 5)
    assert chosen(("fisheye", 3, 2.0), ("brown", 8, 2.029)) == ("brown", 8)
    assert chosen(("fisheye", 3, 2.0), ("brown", 8, 2.031)) == ("fisheye", 3)


def test_faces_are_tried_where_several_images_tell_and_free_where_flatness_is_stated() -> None:
    assert _faces(GAUGE, 1) == (0,)
    assert _faces(GAUGE, 2) == (0, 3, 7)
    assert _faces(gauge_of(tolerance={"flatness_mm": 0.1}), 1) == (7,)


@pytest.mark.parametrize(("share", "foreign"), [(0.0195, False), (0.0205, True)])
def test_residuals_of_a_fiftieth_of_the_pitch_are_another_gauge(share: float, foreign: bool) -> None:
    view: Any = SimpleNamespace(
        centers_px=30.0 * np.stack(np.meshgrid(range(6), range(5)), -1).reshape(-1, 2), name="g"
    )
    fit: Any = SimpleNamespace(residual_px=[np.full((30, 2), share * 30.0)])
    if not foreign:
        _check_pitch(fit, [view], GAUGE)
        return
    with pytest.raises(ImageError, match="of their distance"):
        _check_pitch(fit, [view], GAUGE)


@pytest.mark.parametrize(("dots", "left", "refused"), [(90, 60, False), (90, 59, True), (8, 6, False), (7, 5, True)])
def test_an_image_is_refused_a_third_of_whose_dots_contradict_the_rest(dots: int, left: int, refused: bool) -> None:
    assert FEWEST_DOTS // 2 == 6
    views: list[Any] = [type("V", (list,), {"name": "g.png"})([0] * dots)]
    if not refused:
        _check_left_out(views, [range(left)])  # type: ignore[list-item]
        return
    with pytest.raises(ImageError, match=f"{dots - left} of {dots} dots contradict any camera"):
        _check_left_out(views, [range(left)])  # type: ignore[list-item]


def test_images_are_left_out_as_long_as_three_remain_and_that_of_the_plate_never() -> None:
    faults = Faults("plate", 5, strict=False)
    faults.add(ImageError("a", "blurred"))
    faults.add(ImageError("b", "empty"))
    assert faults.found == (("a", "blurred"), ("b", "empty"))
    with pytest.raises(CalibrationError, match="3 of 5 images cannot be used"):
        faults.add(ImageError("c", "dark"))
    with pytest.raises(CalibrationError, match="defines the plate frame"):
        Faults("plate", 5, strict=False).add(ImageError("plate", "dark"))
    for count, strict in ((5, True), (1, False)):
        with pytest.raises(ImageError):
            Faults("plate", count, strict=strict).add(ImageError("a", "dark"))


def test_parameters_of_a_lens_stand_after_those_of_its_pose() -> None:
    assert PARAMETERS[6:] == LENS_PARAMETERS
    _, state = bundle(1)
    assert state.free_index.tolist() == [0, 2, 3, 4]
    assert state.parameters(0) == pytest.approx(CAMERA.parameters)
