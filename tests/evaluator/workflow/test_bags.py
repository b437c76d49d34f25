"""Runs given as recordings of ROS, written by rosbags itself: topics, units, clocks, covariances, faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

rosbags = pytest.importorskip("rosbags", reason="needs rosbags: pip install 'turnscope[ros]'")

from rosbags.rosbag1 import Writer as WriterOfRos1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

from evaluator.errors import InputError  # noqa: E402
from evaluator.interchange.bags import Topics, read_commands, read_trajectory  # noqa: E402
from evaluator.interchange.commands import from_log  # noqa: E402
from evaluator.interchange.poses import poses_of, read_poses  # noqa: E402
from evaluator.workflow import analyze, check_experiment  # noqa: E402
from simulator.command import Command  # noqa: E402
from simulator.robot import load_robot  # noqa: E402
from simulator.run import State  # noqa: E402
from simulator.simulation import simulate  # noqa: E402
from tests.evaluator.workflow.ros import EPOCH_S, NS, bag, frames, joints, numbers, odometry, transform, twist  # noqa: E402

LONGEST = b"\xff" * 8


def drive_in_bag(folder: Path, late_s: float) -> Path:
    """An experiment of one bag: two phases of the paper's robot; its motion late_s later than its commands say."""
    command = Command.steps([(0.5, 33.3, 14.4), (4.0, -20.0, -33.3), (8.0, 0.0, 0.0)])
    times = np.arange(540) / 60
    run = simulate(load_robot("barrel"), command, times, State(5.0, -3.0, 3.0))
    noise = np.random.default_rng(3).normal(0, 1, (len(times), 3)) * [4e-6, 4e-6, 0.002]
    with bag(folder / "run") as send:
        for at, left, right in ((0.5, 33.3, 14.4), (2.0, 33.3, 14.4), (4.0, -20.0, -33.3), (8.0, 0.0, 0.0)):
            send("/wheels", at, numbers(left * np.pi / 30, right * np.pi / 30))
        for at, x, y, heading, off in zip(times, run.x_mm, run.y_mm, run.heading_rad, noise, strict=True):
            pose = np.array([x / 1000, y / 1000, heading]) + off
            send("/odom", at, odometry(at + late_s, *map(float, pose)))
    path = folder / "experiment.toml"
    path.write_text(
        'format = 1\nname = "bag"\nrobot = "barrel"\n[commands]\ntopic = "/wheels"\nposes_topic = "/odom"\n'
        '[[run]]\nid = "r01"\ncommands = "run/run.mcap"\nposes = "run"\n'
    )
    return path


def test_phases_of_a_bag_are_measured_and_the_offset_of_its_clocks_is_found_to_a_millisecond(tmp_path: Path) -> None:
    late_s = 0.137
    path = drive_in_bag(tmp_path, late_s)
    assert check_experiment(path).faults == ()
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    assert found.faults == {}
    rows = found.turning.to_dict("records")
    assert [(round(row["left_rpm"], 6), round(row["right_rpm"], 6)) for row in rows] == [(33.3, 14.4), (-20.0, -33.3)]
    for row in rows:
        assert row["late_low_s"] < late_s < row["late_high_s"]
        assert row["late_s"] == pytest.approx(late_s, abs=1e-3)
    assert found.comparison is not None
    assert found.comparison["gap_rms_mm"].max() < 2.0  # the simulation starts late_s early


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_velocity_becomes_wheel_speeds_by_the_lengths_of_the_controller(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    with bag(tmp_path / "run", storage) as send:
        send("/cmd_vel", 0.25, twist(0.5, 0.0))
        send("/cmd_vel", 1.25, twist(0.0, 1.0))
    lengths = Topics(wheel_radius_m=0.1, track_m=0.4)
    times, sides = read_commands(tmp_path / "run", lengths)
    assert times - EPOCH_S == pytest.approx([0.25, 1.25], abs=1e-6)
    assert sides == pytest.approx(np.array([[5.0, 5.0], [-2.0, 2.0]]))
    told = from_log(tmp_path / "run", -EPOCH_S, topics=lengths)
    assert told.main(1.3, 2.0) == pytest.approx((-2.0 * 30 / np.pi, 2.0 * 30 / np.pi))
    with pytest.raises(InputError, match="give wheel_radius_m and track_m"):
        from_log(tmp_path / "run")


def test_joints_of_a_side_count_by_their_mean_and_one_that_is_missing_is_named(tmp_path: Path) -> None:
    names = ["front_left", "rear_left", "right"]
    with bag(tmp_path / "run") as send:
        send("/joints", 0.0, joints(names, [1.0, 3.0, 5.0]))
    both = Topics(left_joint=("front_left", "rear_left"), right_joint="right")
    assert read_commands(tmp_path / "run", both)[1].tolist() == [[2.0, 5.0]]
    with pytest.raises(InputError, match="no velocity of left; its joints are front_left, rear_left, right"):
        read_commands(tmp_path / "run", Topics(left_joint="left", right_joint="right"))


def test_covariances_of_odometry_are_used_where_they_are_stated(tmp_path: Path) -> None:
    stated = np.diag([4e-4, 9e-4, 1.0, 1.0, 1.0, 1e-4])
    stated[0, 1] = stated[1, 0] = 1e-4
    for name, covariance in (("with", stated), ("without", None)):
        with bag(tmp_path / name) as send:
            for step in range(20):
                send("/odom", step / 10, odometry(step / 10, step / 100, 0.0, 1.0, covariance))
    found = read_poses(tmp_path / "with")
    assert found.noise_stated
    assert found.zero_s == EPOCH_S
    wanted = [[400.0, 100.0, 0.0], [100.0, 900.0, 0.0], [0.0, 0.0, 1e-4]]
    assert poses_of(found.table).covariance[0] == pytest.approx(np.array(wanted))
    assert not read_poses(tmp_path / "without").noise_stated
    assert np.isnan(read_trajectory(tmp_path / "without", Topics())[2]).all()


def test_topics_that_fit_are_listed_where_the_file_does_not_say_which(tmp_path: Path) -> None:
    with bag(tmp_path / "run") as send:
        send("/a", 0.0, numbers(1.0, 2.0))
        send("/b", 0.0, numbers(1.0, 2.0))
        send("/odom", 0.0, odometry(0.0, 0.0, 0.0, 0.0))
    fit = r"/a \(Float64MultiArray\), /b \(Float64MultiArray\)"
    with pytest.raises(InputError, match=rf"say \[commands\] topic in experiment.toml; topics that fit: {fit}"):
        read_commands(tmp_path / "run", Topics())
    with pytest.raises(InputError, match=r"there is no topic /c"):
        read_commands(tmp_path / "run", Topics(topic="/c"))
    with pytest.raises(InputError, match="topic /odom holds Odometry"):
        read_commands(tmp_path / "run", Topics(topic="/odom"))
    assert read_commands(tmp_path / "run", Topics(topic="/b"))[1].tolist() == [[1.0, 2.0]]


def test_a_transform_is_a_pose(tmp_path: Path) -> None:
    with bag(tmp_path / "run") as send:
        for k in range(3):
            send("/vicon/robot", 0.1 * k, transform(0.1 * k, 0.5 * k, -0.2, 0.3))
            send("/tf", 0.1 * k, frames(transform(0.1 * k, 0.0, 0.0, 0.0, "wheel")))
    time, pose, _ = read_trajectory(tmp_path / "run", Topics())
    np.testing.assert_allclose(time - EPOCH_S, [0.0, 0.1, 0.2], atol=1e-6)
    np.testing.assert_allclose(pose, [[0.0, -0.2, 0.3], [0.5, -0.2, 0.3], [1.0, -0.2, 0.3]], atol=1e-9)


def test_of_many_transforms_those_of_the_stated_frame_are_read(tmp_path: Path) -> None:
    with bag(tmp_path / "run") as send:
        send("/tf", 0.0, frames(transform(0.0, 1.0, 2.0, 0.1), transform(0.0, 9.0, 9.0, 0.0, "wheel")))
        send("/tf", 0.1, frames(transform(0.1, 9.0, 9.0, 0.0, "wheel")))
        send("/tf", 0.2, frames(transform(0.2, 3.0, 4.0, 0.2)))
    pose = read_trajectory(tmp_path / "run", Topics(poses_frame="base_link"))[1]
    np.testing.assert_allclose(pose, [[1.0, 2.0, 0.1], [3.0, 4.0, 0.2]], atol=1e-9)
    with pytest.raises(InputError, match=r"say \[commands\] poses_frame.*base_link, wheel"):
        read_trajectory(tmp_path / "run", Topics())
    with pytest.raises(InputError, match="no message of this frame"):
        read_trajectory(tmp_path / "run", Topics(poses_frame="arm"))


def test_a_pose_that_was_delivered_twice_counts_once_and_is_noted(tmp_path: Path) -> None:
    with bag(tmp_path / "run") as send:
        for at in (0.0, 0.1, 0.1, 0.2, 0.3):
            send("/odom", at, odometry(at, at, 0.0, 0.0))
    found = read_poses(tmp_path / "run")
    assert found.table["x_mm"].tolist() == pytest.approx([0.0, 100.0, 200.0, 300.0])
    assert "1 pose came twice with the same time; one of each counts" in found.notes()


def test_a_bag_of_ros_1_is_read_alike(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/Twist"
    with WriterOfRos1(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/cmd_vel", kind, typestore=store)
        three = store.types["geometry_msgs/msg/Vector3"]
        message = store.types[kind](linear=three(x=0.5, y=0.0, z=0.0), angular=three(x=0.0, y=0.0, z=0.0))
        writer.write(connection, EPOCH_S * NS, store.serialize_ros1(message, kind))
    found = read_commands(tmp_path / "run.bag", Topics(wheel_radius_m=0.1, track_m=0.4))
    assert found[1].tolist() == [[5.0, 5.0]]


def test_a_file_that_is_no_recording_is_named_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no recording")
    with pytest.raises(InputError, match=r"run\.mcap: not a readable ROS recording"):
        read_commands(tmp_path / "run.mcap", Topics())
    with pytest.raises(InputError, match="no such file"):
        read_commands(tmp_path / "none.mcap", Topics())


def of_an_endless_record(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:9] + LONGEST + content[17:])  # length of the first record, after magic and kind


def of_a_message_without_a_pose(path: Path) -> None:
    content = path.read_bytes()
    assert content.count(b"PoseWithCovariance pose") >= 1
    path.write_bytes(content.replace(b"PoseWithCovariance pose", b"PoseWithCovariance posf"))


def of_pages_full_of_zeros(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:4096] + bytes(len(content) - 4096))


@pytest.mark.parametrize(
    ("storage", "spoil"),
    [
        (StoragePlugin.MCAP, of_an_endless_record),
        (StoragePlugin.MCAP, of_a_message_without_a_pose),
        (StoragePlugin.SQLITE3, of_pages_full_of_zeros),
    ],
)
def test_a_damaged_recording_is_one_sentence(
    tmp_path: Path, storage: StoragePlugin, spoil: Callable[[Path], None]
) -> None:
    with bag(tmp_path / "run", storage) as send:
        for k in range(4):
            send("/odom", k / 10, odometry(k / 10, 0.0, 0.0, 0.0))
    (path,) = (file for file in (tmp_path / "run").iterdir() if file.suffix in (".mcap", ".db3"))
    assert len(read_poses(path).table) == 4
    spoil(path)
    with pytest.raises(InputError, match="not a readable ROS recording"):
        read_poses(path)


def test_a_rotation_beyond_every_number_is_one_sentence(tmp_path: Path) -> None:
    message = odometry(0.0, 0.0, 0.0, 0.0)
    message.pose.pose.orientation.w = 1e300
    with bag(tmp_path / "run") as send:
        send("/odom", 0.0, message)
    with pytest.raises(InputError, match="not a readable ROS recording"):
        read_poses(tmp_path / "run")
