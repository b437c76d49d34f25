"""What makes a clip hard is in the image, and the truth says so."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from simulator.rendering import Scene, render_clip, render_frames, set_stage, truth_of
from simulator.rendering.video import encode

SMALL: dict[str, Any] = {
    "format": 1,
    "seed": 5,
    "duration_s": 0.1,
    "camera": {"size_px": (320, 240), "focal_px": 1800.0, "distance_mm": 150.0},
    "sensor": {"full_well_e": 0.0},
    "motion": {"kind": "line", "speed_mm_s": 0.0},
}


def first_image(**changes: Any) -> np.ndarray:
    return next(render_frames(Scene.model_validate(SMALL | changes))).image.astype(float)


def truth(**changes: Any) -> Any:
    return truth_of(set_stage(Scene.model_validate(SMALL | changes)))


def at_mark(image: np.ndarray, name: str = "green") -> np.ndarray:
    row = truth().iloc[0]
    return np.asarray(image[round(row[f"{name}_y_px"]), round(row[f"{name}_x_px"])])


def test_wire_over_a_mark_darkens_it_and_lowers_its_visible_share() -> None:
    x, y = truth()[["green_x_px", "green_y_px"]].iloc[0]
    wire = [{"points_px": [(x - 50, y), (x + 50, y)], "width_px": 4.0}]
    assert at_mark(first_image(wire=wire))[1] < 0.3 * at_mark(first_image())[1]
    share = truth(wire=wire)["green_visible"].iloc[0]
    radius_px = 0.5 * 1800 / (150 - 6.5)
    covered = 2 * (np.arcsin(2 / radius_px) + 2 / radius_px * np.sqrt(1 - (2 / radius_px) ** 2)) / np.pi
    assert share == pytest.approx(1 - covered, abs=0.02)
    assert truth(wire=wire)["yellow_visible"].iloc[0] == 1


def test_glare_adds_light() -> None:
    spot = [{"x_px": 60.0, "y_px": 60.0, "radius_px": 10.0, "strength": 0.3}]
    added = first_image(glare=spot) - first_image()
    assert added[60, 60] == pytest.approx(0.3 * 255, abs=1)
    assert np.abs(added[200, 200]).max() == 0


def test_marks_swap_colours_where_asked() -> None:
    swapped = first_image(marks={"swap_colors": True})
    assert at_mark(swapped, "green")[0] > 2 * at_mark(first_image(), "green")[0]
    assert at_mark(swapped, "yellow")[0] < 0.5 * at_mark(first_image(), "yellow")[0]


def test_distractor_moves_under_the_robot() -> None:
    disc = [{"x_mm": 9.0, "y_mm": 0.0, "velocity_mm_s": (-20.0, 0.0), "color": (0.9, 0.1, 0.1)}]
    clip = Scene.model_validate(SMALL | {"distractor": disc, "duration_s": 0.5})
    images = [frame.image for frame in render_frames(clip)]
    row = round(119.5)
    beside = round(159.5 + 9 * 12)
    assert images[0][row, beside, 0] > 1.5 * images[0][row, beside, 1]
    assert np.ptp(images[-1][row, beside].astype(int)) < 10
    assert images[-1][row, 160].max() < 25  # the robot hides it


def test_light_switched_on_midway() -> None:
    clip = Scene.model_validate(SMALL | {"lighting": {"switched_at_s": 0.04, "level_before": 0.2}})
    means = [frame.image.mean() / 255 - 0.02 for frame in render_frames(clip)]
    assert means[0] == pytest.approx(0.2 * means[-1], rel=0.03)
    assert np.argmax(np.diff(means)) == 2  # frame 3 is the first after 0.04 s


def test_mark_saturates_at_high_gain() -> None:
    assert at_mark(first_image(exposure={"gain": 2.0}))[1] == 255


def test_robot_that_leaves_the_image_is_truthfully_invisible() -> None:
    table = truth(motion={"kind": "line", "speed_mm_s": 200.0}, duration_s=0.2)
    assert table["green_visible"].iloc[0] == 1
    assert table["green_visible"].iloc[-1] == 0
    assert set(np.sign(np.diff(table["green_visible"]))) == {0.0, -1.0}


@pytest.mark.parametrize(("axis", "edge_px"), [("x", -0.5), ("x", 319.5), ("y", -0.5), ("y", 239.5)])
def test_half_of_a_mark_is_visible_whose_centre_lies_on_the_edge_of_the_image(axis: str, edge_px: float) -> None:
    px_per_mm = (1 if axis == "x" else -1) * 1800 / (150 - 6.5)
    off_mm = (edge_px - truth()[f"green_{axis}_px"].iloc[0]) / px_per_mm
    table = truth(motion={"kind": "line", "speed_mm_s": 0.0, f"{axis}_mm": off_mm})
    assert table["green_visible"].iloc[0] == pytest.approx(0.5, abs=0.02)


def test_side_of_the_body_is_darker_than_its_top_where_it_is_seen_from_beside() -> None:
    said: dict[str, Any] = {
        "sensor": {"full_well_e": 0.0, "bits": 16, "black_level": 0.0},
        "optics": {"vignetting": 0.0},
    }
    straight = first_image(**said, exposure={"gain": 1.5}) / 65535
    assert straight[120, 160] == pytest.approx([1.5 * 0.045, 1.5 * 0.045, 1.5 * 0.048], abs=2e-4)
    beside = first_image(**said, motion={"kind": "line", "speed_mm_s": 0.0, "x_mm": 11.0}) / 65535
    # What stands up leans away from the middle of the image: the side that is seen is the one toward it.
    side = int(np.argmin(beside[120, :, 0]))
    assert 160 < side < 160 + 11 * 12
    assert beside[120, side] == pytest.approx([0.012, 0.012, 0.014], abs=2e-3)  # what is left of the blur


def test_repeated_frame_is_the_one_before_it_and_keeps_its_time() -> None:
    moving = {"motion": {"kind": "line", "speed_mm_s": 50.0, "start_s": -1.0}, "timing": {"repeated": (3,)}}
    frames = list(render_frames(Scene.model_validate(SMALL | moving | {"sensor": {}})))
    assert np.array_equal(frames[3].image, frames[2].image)
    assert not np.array_equal(frames[4].image, frames[3].image)
    table = truth(**moving)
    assert table["time_s"].iloc[3] == pytest.approx(2 / 60)
    assert table["presentation_s"].iloc[3] == pytest.approx(3 / 60)


def test_jittered_times_in_the_file_are_those_of_the_exposures(tmp_path: Path) -> None:
    clip = Scene.model_validate(SMALL | {"timing": {"jitter_s": 0.003}})
    table = render_clip(clip, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        shown = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
    assert table["time_s"].to_numpy() == pytest.approx(shown, abs=1e-9)
    assert np.ptp(np.diff(shown)) > 0.001


def test_fields_weave_images_of_two_times() -> None:
    fast = SMALL | {"motion": {"kind": "line", "speed_mm_s": 100.0, "start_s": -1.0}, "duration_s": 1 / 60}
    woven = next(render_frames(Scene.model_validate(fast | {"timing": {"interlaced": "top_first"}}))).image
    early = next(render_frames(Scene.model_validate(fast))).image
    twice = fast | {"frame_rate": "120", "duration_s": 2 / 120}
    late = list(render_frames(Scene.model_validate(twice)))[1].image
    assert np.array_equal(woven[::2], early[::2])
    assert np.array_equal(woven[1::2], late[1::2])


def test_fields_are_coded_the_same_whenever_they_are_written(tmp_path: Path) -> None:
    scene = Scene.model_validate(
        SMALL | {"motion": {"kind": "circle", "radius_mm": 3.0, "speed_mm_s": 8.0}, "duration_s": 1.5}
        | {"timing": {"interlaced": "top_first"}, "frame_rate": "30"}
    )  # fmt: skip
    contents, frames = [], [(frame.presentation_s, frame.image) for frame in render_frames(scene)]
    for name in ("one.mp4", "two.mp4"):
        encode(frames, scene, Fraction(1, 30), (320, 240), tmp_path / name)
        with av.open(str(tmp_path / name)) as container:
            contents.append([bytes(packet) for packet in container.demux(video=0)])
    assert contents[0] == contents[1]


def test_coded_fields_keep_their_colours_and_their_order(tmp_path: Path) -> None:
    motion = {"kind": "line", "speed_mm_s": 100.0, "start_s": -1.0, "x_mm": -100.0}
    for order, top_first in (("top_first", "1"), ("bottom_first", "0")):
        clip = Scene.model_validate(SMALL | {"motion": motion, "timing": {"interlaced": order}, "duration_s": 0.05})
        render_clip(clip, tmp_path / "clip.mp4")
        with av.open(str(tmp_path / "clip.mp4")) as container:
            stored = next(container.decode(video=0))
        assert stored.interlaced_frame
        y, x = (int(truth(motion=motion)[f"green_{axis}_px"].iloc[0]) for axis in "yx")
        first = int(top_first == "0")
        rows = slice(y - y % 2 + first, y - y % 2 + first + 1)
        red, green, _ = stored.to_ndarray(format="rgb24")[rows, x - 1 : x + 2].mean(axis=(0, 1))
        assert green > 3 * red  # colour shared between fields would be half as vivid here


def test_smear_is_the_mean_over_the_exposure() -> None:
    sharp = SMALL | {
        "motion": {"kind": "circle", "radius_mm": 5.0, "speed_mm_s": 60.0, "start_s": -1.0},
        "sensor": {"full_well_e": 0.0, "bits": 16},
    }
    whole = Scene.model_validate(sharp | {"exposure": {"time_s": 0.01}, "frame_rate": "100", "duration_s": 0.02})
    smeared = list(render_frames(whole))[1].image.astype(float)
    # The second frame is open from 5 to 15 ms: the same turn, begun 5 ms sooner, in 64 steps.
    sooner = {"motion": sharp["motion"] | {"start_s": -1.005}, "exposure": {"time_s": 0.0}}
    instants = Scene.model_validate(sharp | sooner | {"frame_rate": "6400", "duration_s": 65 / 6400})
    moments = [frame.image.astype(float) for frame in render_frames(instants)]
    exact = (np.sum(moments, axis=0) - (moments[0] + moments[-1]) / 2) / 64
    assert np.abs(smeared - exact).max() / 65535 < 2e-3


@pytest.mark.parametrize(
    ("encoding", "sensor", "pixel_format"),
    [
        ({"codec": "mjpeg"}, {}, "yuvj420p"),
        ({"codec": "h264"}, {"bits": 10}, "yuv420p10le"),
        ({"codec": "h264", "chroma": "444"}, {}, "yuv444p"),
        ({"codec": "ffv1"}, {"bits": 16, "color": False}, "gray16le"),
        ({"codec": "ffv1"}, {"bits": 8, "color": False}, "gray"),
    ],
)
def test_codecs_and_depths(tmp_path: Path, encoding: Any, sensor: Any, pixel_format: str) -> None:
    clip = Scene.model_validate(SMALL | {"encoding": encoding, "sensor": sensor, "frame_rate": "60000/1001"})
    render_clip(clip, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        assert container.streams.video[0].codec_context.pix_fmt == pixel_format
        shown = [frame.pts * frame.time_base for frame in container.decode(video=0)]
    assert shown == [k / Fraction(60000, 1001) for k in range(6)]


def test_deep_grey_ffv1_holds_the_very_numbers(tmp_path: Path) -> None:
    sensor = {"bits": 10, "color": False}
    clip = Scene.model_validate(SMALL | {"encoding": {"codec": "ffv1"}, "sensor": sensor})
    render_clip(clip, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        stored = next(container.decode(video=0)).to_ndarray(format="gray16le")
    assert np.array_equal(stored >> 6, next(render_frames(clip)).image)


def test_poses_from_a_file_are_followed(tmp_path: Path) -> None:
    times = np.linspace(0, 1, 21)
    lines = [f"{t},{3 * t},{-(t**2)},{170 + 40 * t if 170 + 40 * t < 180 else 40 * t - 190}" for t in times]
    (tmp_path / "poses.csv").write_text("time_s,x_mm,y_mm,heading_deg\n" + "\n".join(lines))
    table = truth(motion={"kind": "poses", "file": tmp_path / "poses.csv"}, duration_s=1.0)
    assert np.abs(table["x_mm"] - 3 * table["time_s"]).max() < 1e-3
    assert np.abs(table["heading_deg"] - 170 - 40 * table["time_s"]).max() < 1e-3


def test_marks_are_drawn_where_an_observation_effect_moves_them() -> None:
    moved = truth(effect=[{"id": "mark-offset", "x_mm": 0.3, "y_mm": 0.0, "angle_deg": 0.0}])
    assert moved["green_x_mm"].iloc[0] == pytest.approx(truth()["green_x_mm"].iloc[0] + 0.3)
    assert moved["x_mm"].iloc[0] == truth()["x_mm"].iloc[0]
    x, y = (round(moved[f"green_{axis}_px"].iloc[0]) for axis in "xy")
    shifted = first_image(effect=[{"id": "mark-offset", "x_mm": 0.3}])
    assert shifted[y, x] == pytest.approx(at_mark(first_image()), abs=3)


def test_recorder_with_a_wrong_clock_says_wrong_times(tmp_path: Path) -> None:
    clip = Scene.model_validate(SMALL | {"effect": [{"id": "time-base", "factor": 1.01}]})
    table = render_clip(clip, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        shown = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
    assert shown == pytest.approx(list(1.01 * table["time_s"]), abs=1e-5)


def test_physics_of_the_scene_moves_the_robot() -> None:
    motion = {"kind": "simulate", "left_rpm": 33.3, "right_rpm": 14.4}
    effect = [{"id": "drive-speed-scale", "factor": 1.1}]
    nominal, faster = (truth(motion=motion, duration_s=1.0, effect=added).iloc[-1] for added in ([], effect))
    assert faster["heading_deg"] / nominal["heading_deg"] == pytest.approx(1.1, abs=0.01)


def test_misspelt_effect_is_explained() -> None:
    with pytest.raises(ValueError, match="did you mean plate-tilt"):
        Scene.model_validate(SMALL | {"effect": [{"id": "plate-tild", "angle_deg": 1.0}]})
