"""How a tracker begins: what it waits for, and as what it follows a mark, with searches that are made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.detection.find import Reading
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.following import tracker as module
from evaluator.tracking.observation import ABSENT, Sighting
from tests.evaluator.tracking.test_tracker_choices import Disc, at, following, frame, paired

GREEN = Candidate("green", (50.0, 40.0), 5.0, 1.2, 80.0, (90.0, 90.0))
YELLOW = Candidate("yellow", (90.0, 40.0), 5.0, 1.2, 80.0, (90.0, 160.0))


def discovering(monkeypatch: pytest.MonkeyPatch, found: dict[str, Candidate], *, rivals: bool = False) -> Any:
    """A tracker that has seen nothing; notes what it starts to follow."""
    one = following()
    one.started = []
    one.second_look = SimpleNamespace(better=lambda *_: None, note=lambda *_: None, begin=lambda: None)
    one._rivals = SimpleNamespace(
        undecided=rivals, decide=lambda _found, _settings, chosen: chosen, there=lambda *_: False
    )
    monkeypatch.setattr(module, "find_marks", lambda *_: Reading(found, list(found.values()), 0.5))
    monkeypatch.setattr(one, "_start_all", lambda _frame, chosen, balance: one.started.append((chosen, balance)))
    return one


def test_one_mark_of_a_pair_is_followed_alone_after_thirty_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    one = discovering(monkeypatch, {"green": GREEN})
    for index in range(30):
        assert one.started == []
        one._discover(frame(index))
    assert one.started == [({"green": GREEN}, 0.5)]
    one = discovering(monkeypatch, {"green": GREEN}, rivals=True)  # while lookalikes may be the robot, none is
    for index in range(40):
        one._discover(frame(index))
    assert one.started == []
    one = discovering(monkeypatch, {"green": GREEN, "yellow": YELLOW})
    one._discover(frame())
    assert len(one.started) == 1
    one = discovering(monkeypatch, {"yellow": YELLOW})
    one.followers = {"green": Disc()}
    one._discover(frame())
    assert one.started == [({"yellow": YELLOW}, 0.5)]
    one.followers = {"green": Disc(), "yellow": Disc()}
    one._discover(frame())
    assert len(one.started) == 1


def test_another_pair_begins_anew_but_for_a_mark_that_is_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    one = discovering(monkeypatch, {})
    one.followers = {"green": Disc(position=(50.0, 40.0)), "yellow": Disc(position=(300.0, 300.0))}
    paired(one)
    green = one.followers["green"]
    better = SimpleNamespace(chosen={"green": GREEN, "yellow": YELLOW}, balance=0.25)
    one.second_look.better = lambda *_: better
    monkeypatch.setattr(module, "find_marks", lambda *_: Reading({}, [], 1.0))
    one._discover(frame(7))
    assert one.followers == {"green": green}
    assert one.began == {"yellow": 7}
    assert one.started == [({"yellow": YELLOW}, 0.25)]
    assert not one.body.known


def test_a_pair_that_rested_while_the_robot_began_to_move_is_not_begun_with_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A film with a second robot at rest followed that from frame 50 on, for 27 mm, at a stated 1 µm."""
    one = discovering(monkeypatch, {})
    followed = {"green": Disc(position=(200.0, 40.0)), "yellow": Disc(position=(300.0, 300.0))}
    one.followers = dict(followed)
    one.second_look.better = lambda *_: SimpleNamespace(chosen={"green": GREEN, "yellow": YELLOW}, balance=0.25)
    one._rivals.there = lambda place, radius_px: (place, radius_px) == (YELLOW.center_px, YELLOW.radius_px)
    one._discover(frame(7))
    assert (one.followers, one.started) == (followed, [])


def started(monkeypatch: pytest.MonkeyPatch, disc: Any, candidate: Candidate = GREEN, **state: Any) -> Any:
    """A tracker that has begun to follow a blob whose shape is learnt to be a disc, or none."""
    one = following()
    for name, value in state.items():
        setattr(one, name, value)
    monkeypatch.setattr(module, "patch_of", lambda *_: None)
    monkeypatch.setattr(module, "learn_shape", lambda *_: None)
    monkeypatch.setattr(module, "finished", lambda _steps: disc)
    monkeypatch.setattr(module, "start_blob", lambda *_: "blob")
    monkeypatch.setattr(module, "shaped_as", lambda mine, other: SimpleNamespace(radius_px=other.radius_px, of=mine))
    monkeypatch.setattr(module, "Follower", Disc)
    monkeypatch.setattr(Disc, "__init__", lambda self, look, exposure: vars(self).update(look=look, exposure=exposure))
    one._start("green", frame(3), candidate, np.zeros(6))
    return one


def test_a_mark_begins_as_a_disc_or_after_three_frames_without_one_as_a_blob(monkeypatch: pytest.MonkeyPatch) -> None:
    disc = SimpleNamespace(radius_px=7.0)
    cut = Candidate("green", (50.0, 40.0), 5.0, 1.2, 80.0, (90.0, 90.0), whole=False)
    assert started(monkeypatch, disc, cut).followers == {}
    first = started(monkeypatch, disc).followers["green"]
    assert (first.look.disc, first.position, first.time_s) == (disc, GREEN.center_px, 0.05)
    assert first.look.area_px2 == pytest.approx(np.pi * 0.8 * 49)
    small = started(monkeypatch, SimpleNamespace(radius_px=5.0)).followers["green"]
    assert small.look.area_px2 == pytest.approx(np.pi * 25)
    assert started(monkeypatch, None).followers == {}
    assert started(monkeypatch, None)._starts == {"green": (3, "blob")}
    assert started(monkeypatch, None, _discless={"green": 1}).followers == {}
    assert started(monkeypatch, None, _discless={"green": 2}).followers == {"green": "blob"}
    oblong = Candidate("green", (50.0, 40.0), 5.0, 1.5, 80.0, (90.0, 90.0))
    assert started(monkeypatch, disc, oblong, _settled=True).followers == {"green": "blob"}
    assert started(monkeypatch, disc, _settled=True).followers != {"green": "blob"}
    assert started(monkeypatch, disc, oblong).followers != {"green": "blob"}


@pytest.mark.parametrize(("seen", "radius"), [(12, 9.0), (11, 7.0)])
def test_a_mark_that_was_hidden_long_has_the_shape_of_its_partner(
    seen: int, radius: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    partner = Disc(seen=seen, look=SimpleNamespace(disc=SimpleNamespace(radius_px=9.0)))
    one = started(monkeypatch, SimpleNamespace(radius_px=7.0), followers={"yellow": partner})
    assert one.followers["green"].look.disc.radius_px == radius


@pytest.mark.parametrize("frames", [20, 9])
def test_the_first_twelve_frames_with_a_mark_are_given_once_its_shape_is_learnt(
    frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is seen in three frames."""
    one, lessons = following(), list[int]()

    def step(seen: Any) -> list[Sighting]:
        if seen.index == 3:
            one.followers["green"] = Disc()
        return [at(seen.index, 0.0)]

    monkeypatch.setattr(one, "step", step)
    monkeypatch.setattr(module, "learn_anew", lambda _f, _s, held, _c: lessons.append(len(held)))
    monkeypatch.setattr(module, "measure_anew", lambda *_: None)
    monkeypatch.setattr(module, "choose_shapes", lambda *_: None)
    given, order = [], []

    def recorded() -> Any:
        for index in range(frames):
            order.append(len(given))
            yield frame(index)

    for seen, sightings in one.run(recorded()):
        given.append(seen.index)
        assert sightings == [at(seen.index, 0.0)]
    assert given == list(range(frames))
    assert lessons[0] == min(frames - 3, 12)
    # Two frames wait for a mark that may be in them.
    assert order == [0, 0, 0, 1, *[3] * (min(frames - 3, 12) - 1), *range(15, frames)]


def test_of_pairs_that_look_alike_the_one_that_moved_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = {"green": YELLOW, "yellow": GREEN}
    for found, expected in (({"green": GREEN, "yellow": YELLOW}, moved), ({"green": GREEN}, {"green": GREEN})):
        one = discovering(monkeypatch, found)
        one._rivals.decide = lambda *_: moved
        one._waited = 99
        one._discover(frame())
        assert one.started == [(expected, 0.5)]


def test_marks_begin_with_the_colours_of_all_others_and_at_no_place_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    one, begun, noted = following(), list[Any](), list[Any]()
    monkeypatch.setattr(module, "allowed_cells", lambda *_: None)
    monkeypatch.setattr(module, "neutral_of", lambda _frame, _cells, balance: (128.0, 128.0 + balance))
    monkeypatch.setattr(module, "learn_color", lambda *said: said)
    one.second_look = SimpleNamespace(note=lambda pair, _settings: noted.append(pair))
    monkeypatch.setattr(one, "_start", lambda name, _frame, candidate, color: begun.append((name, candidate, color)))
    one._start_all(frame(), {"green": GREEN, "yellow": YELLOW}, 0.25)
    assert noted == [{"green": GREEN, "yellow": YELLOW}]
    assert begun == [
        ("green", GREEN, (GREEN, [YELLOW.chroma_uv], (128.0, 128.25))),
        ("yellow", YELLOW, (YELLOW, [GREEN.chroma_uv], (128.0, 128.25))),
    ]
    begun.clear()
    monkeypatch.setattr(one, "_followed", lambda *_: ABSENT["not seen"])
    one.followers["yellow"] = Disc(position=(50.0, 41.0), velocity=(0.0, 0.0))
    one._start_all(frame(), {"green": GREEN}, 0.25)
    assert begun == []  # two marks are never at one place
    one.followers["yellow"] = Disc(position=(90.0, 41.0), velocity=(0.0, 0.0))
    one._start_all(frame(), {"green": GREEN}, 0.25)
    assert begun == [("green", GREEN, (GREEN, [pytest.approx((128.6, 128.8))], (128.0, 128.25)))]
    assert len(noted) == 1


def test_frames_leave_in_order_if_a_mark_is_given_up_and_begun_again(monkeypatch: pytest.MonkeyPatch) -> None:
    one = following()
    monkeypatch.setattr(one, "_learnt", lambda unlearnt, held: [*unlearnt, *held])
    monkeypatch.setattr(module, "look_back", lambda _followers, _names, before, _cell: len(before) // 2)

    def step(shown: Any) -> list[Sighting]:
        one.followers = {"green": Disc()} if 4 <= shown.index < 7 or shown.index >= 9 else {}
        return [ABSENT["not seen"]] * 2

    monkeypatch.setattr(one, "step", step)
    frames = [frame(index) for index in range(50)]
    assert [shown.index for shown, _ in one.run(frames)] == list(range(50))
    one.followers, frames = {}, frames[:3]
    assert [shown.index for shown, _ in one.run(frames)] == list(range(3))
