"""Which path a follower takes in a frame: fast, slow, or with another light or shutter; each limit from either side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.following import follow
from evaluator.tracking.observation import ABSENT, AMBIGUOUS, OK
from evaluator.tracking.refinement import fast_path, kernels
from tests.evaluator.tracking.test_follower_formulas import AREA, at, follower, found, frame

SEEN = frame(1.1)
SEEN.u = SEEN.v = None


def looking(one: Any, verdict: int, monkeypatch: pytest.MonkeyPatch, **said: Any) -> list[Any]:
    """What a follower does where its fast path has a verdict, in order."""
    done = list[Any]()

    def fit_mark(*given: Any) -> int:
        done.append(given[6:11])
        return verdict

    def measured(*_: object, with_rim: bool = False) -> str:
        done.append(("measured", with_rim))
        return "measured"

    monkeypatch.setattr(fast_path, "fit_mark", fit_mark)
    monkeypatch.setattr(one._slow_path, "begin", lambda _: said.get("lookout", False))
    monkeypatch.setattr(one._slow_path, "regular", lambda _: True)
    monkeypatch.setattr(
        one._slow_path, "refit", lambda _, suspicious: done.append(("refit", suspicious)) or said.get("taken", False)
    )
    monkeypatch.setattr(one, "_measured", measured)
    monkeypatch.setattr(one, "_explain_disturbance", lambda *_: done.append("explained"))
    monkeypatch.setattr(one, "_judged", lambda *_: done.append("judged"))
    one._result[kernels.RESIDUAL] = said.get("residual", 1.0)
    done.append(one.look_at(SEEN, np.zeros(4), said.get("place", (50.0, 40.0)), 3.0, 0.1))
    return done


@pytest.mark.parametrize(("turn", "path"), [(0.0, (1.5, -2.0)), (2.0, (1.5, -2.0))])
def test_a_mark_is_looked_for_with_the_smear_of_its_velocity_in_the_middle_of_the_exposure(
    turn: float, path: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of an interval of 0.1 s at (30, -40) px/s, turned on by the 0.15 s from the middle of the last step."""
    one = follower(velocity=(30.0, -40.0), time_s=1.0, turn_rad_s=turn)
    x, y, reach, *smear = looking(one, fast_path.WELL, monkeypatch)[0]
    assert (x, y, reach) == (50.0, 40.0, 3.0)
    cos, sin = math.cos(0.15 * turn), math.sin(0.15 * turn)
    assert smear == pytest.approx([cos * path[0] - sin * path[1], sin * path[0] + cos * path[1]])


@pytest.mark.parametrize(
    ("verdict", "said", "done"),
    [
        (fast_path.WELL, {}, [("measured", False), "measured"]),
        (fast_path.WELL, {"lookout": True}, [("refit", False), ("measured", True), "measured"]),
        (fast_path.WELL, {"lookout": True, "taken": True}, [("refit", False), "judged", None]),
        (fast_path.WELL, {"lookout": True, "residual": 1.4}, [("refit", True), ("measured", True), "measured"]),
        (fast_path.UNUSUAL, {}, ["explained", "judged", None]),
        (fast_path.UNUSUAL, {"residual": 1.32}, ["explained", "judged", None]),  # two scatters of a sixth
        (fast_path.UNUSUAL, {"residual": 1.34}, ["explained", ("refit", True), "judged", None]),
        (fast_path.UNUSUAL, {"lookout": True}, ["explained", ("refit", False), "judged", None]),
        (fast_path.TOO_LITTLE, {}, [ABSENT["not seen"]]),
        (fast_path.TOO_LITTLE, {"place": (7.9, 40.0)}, [ABSENT["outside the image"]]),  # within a radius of the rim
    ],
)
def test_the_slow_path_is_for_what_is_unusual_or_watched(
    verdict: int, said: dict[str, Any], done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = follower()
    one.light.note_fit = lambda *_, **__: None  # type: ignore[method-assign]
    assert looking(one, verdict, monkeypatch, **said)[1:] == done


@pytest.mark.parametrize(
    ("residual", "amplitude", "noise"),
    [
        (1.6, 240.0, 16.0),  # twice as bright: the variance of gain noise grows with its square
        (1.4, 240.0, None),  # nothing disturbs it
        (1.6, 146.0, 4.0 * (146 / 120) ** 2),
        (1.6, 142.0, None),  # a sixth brighter is flicker
        (1.6, 470.0, 60.0),  # thirty times the least noise at most
        (1.6, 481.0, None),  # another object
    ],
)
def test_a_mark_in_other_light_is_fitted_with_its_noise_and_its_brightness(
    residual: float, amplitude: float, noise: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, starts = found(RESIDUAL=residual, AMPLITUDE=amplitude, BASE=80.0), list[Any]()
    monkeypatch.setattr(one._slow_path, "fit", lambda _, start: starts.append(start[2:4].tolist()))
    one._explain_disturbance(SEEN, 0.1)
    assert starts == [[amplitude, 80.0]] * (noise is not None)
    assert one._noise[0] == pytest.approx(4.0 if noise is None else noise)


@pytest.mark.parametrize(
    ("exposure", "interval_s", "residual", "left", "asked", "again"),
    [
        (None, 0.1, 1.6, 1.4, True, False),  # the shutter explains it
        (None, 0.1, 1.6, 1.6, True, True),
        (None, 0.1, 1.4, 9.0, False, False),
        (None, 0.0, 1.6, 9.0, False, True),  # of one frame no interval is known
        (0.5, 0.1, 1.6, 9.0, False, True),  # it was said
    ],
)
def test_the_shutter_is_asked_first_where_nobody_said_it(
    exposure: float | None, interval_s: float, residual: float, left: float, asked: bool, again: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    one, fits, lessons = found(RESIDUAL=residual, AMPLITUDE=240.0), list[Any](), list[Any]()
    one.exposure = exposure
    monkeypatch.setattr(one, "_learn_exposure", lambda *said: lessons.append(said[-1]) or left)
    monkeypatch.setattr(one._slow_path, "fit", lambda *_: fits.append(1))
    one._explain_disturbance(SEEN, interval_s)
    assert (lessons, len(fits)) == ([interval_s] * asked, again)


@pytest.mark.parametrize(("missed", "other", "status"), [(8, True, OK), (9, True, AMBIGUOUS), (9, False, OK)])
def test_what_is_found_after_eight_frames_has_to_have_the_hue_of_the_mark(
    missed: int, other: bool, status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By then the mark may have left the image, and something else be the best of what is there."""
    one = follower(position=(50.0, 40.0), missed=missed)
    monkeypatch.setattr(one, "look_at", lambda *_: at(50.0, 40.0))
    monkeypatch.setattr(follow, "has_another_hue", lambda *_: other)
    assert one.look_again(SEEN, np.zeros(4), (50.0, 40.0), 0.1, (0.0, 0.0), 1.0).status == status


def test_a_look_is_that_of_its_disc() -> None:
    """The inside of a disc of 8 px with a blur of 0.9 ends two and a half blurs before its rim."""
    one = follower()
    assert one._slow_path.inner_px == pytest.approx(8.0 - 2.5 * 0.9)
    assert one._usual.tolist() == pytest.approx([120.0, 40.0, 0.5 / 3, 2.0, AREA])
    assert one._noise.tolist() == [4.0, 5.0]
