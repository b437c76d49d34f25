"""Recordings of ROS: commands and poses from topics of an MCAP file, a rosbag2 folder or a rosbag1 file.

    [commands]                        # of experiment.toml, or one [run.topics] for a run by itself
    topic = "/cmd_vel"                # commands of the motors
    wheel_radius_m = 0.165            # of a velocity command: dimensions in the robot's controller
    track_m = 0.555
    poses_topic = "/odom"             # poses of the robot

A command is a velocity (geometry_msgs Twist or TwistStamped), the joint velocities of the wheels (sensor_msgs
JointState: left_joint and right_joint name theirs, or lists of them, of which the mean counts), or two numbers, left
and right, in rad/s (std_msgs Float32MultiArray or Float64MultiArray). Poses are nav_msgs Odometry, geometry_msgs
PoseStamped, PoseWithCovarianceStamped or TransformStamped, or the transforms of one frame, poses_frame, of a tf2_msgs
TFMessage, which is read where it is named or where there are no other poses. The time of a message is that of its
header or, if the header has none, the time at which it was recorded. Reading needs rosbags (pip install
'turnscope[ros]').
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from evaluator.errors import InputError

Array = NDArray[np.float64]
Row = TypeVar("Row")
S_PER_NS = 1e-9
BAGS = (".mcap", ".bag", ".db3")
METADATA = "metadata.yaml"  # of a rosbag2 folder
FRAMES = "TFMessage"  # transforms of many frames
Joints = str | tuple[str, ...]
Length = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]


class Topics(BaseModel):
    """Topics of a bag with commands and poses, and the conversion of velocities to wheel speeds."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    topic: str | None = None
    wheel_radius_m: Length | None = None
    track_m: Length | None = None
    left_joint: Joints | None = None
    right_joint: Joints | None = None
    poses_topic: str | None = None
    poses_frame: str | None = None


def is_bag(path: Path) -> bool:
    """Whether a path is that of a recording of ROS, by its suffix, or by the content of a folder."""
    return path.suffix.lower() in BAGS or (path / METADATA).is_file()


def read_commands(path: Path, topics: Topics) -> tuple[Array, Array]:
    """Times (n,), s, by the clock of the bag, and commanded speeds of the left and right wheels (n, 2), rad/s.

    Raises InputError for a missing topic, or one that does not determine the wheel speeds.
    """

    def sides(kind: str, message: Any) -> tuple[float, float]:
        return COMMANDS[kind](message, topics, f"{path}: {topics.topic or f'the topic of type {kind}'}")

    rows = _rows(path, topics.topic, COMMANDS, "topic", sides)
    return np.array([at_s for at_s, _ in rows]), np.array([found for _, found in rows])


def read_trajectory(path: Path, topics: Topics) -> tuple[Array, Array, Array]:
    """Times (n,), s, poses (n, 3), m, m and rad, and their covariances (n, 3, 3); NaN where the bag states none.

    Heading: of the body's x axis over the plane of x and y. Raises InputError as read_commands does.
    """
    rows = _rows(
        path,
        topics.poses_topic,
        POSES,
        "poses_topic",
        lambda kind, message: _pose(POSES[kind](message)),
        lambda message: _of_frame(path, message, topics.poses_frame),
    )
    poses, covariances = zip(*(found for _, found in rows), strict=True)
    return np.array([at_s for at_s, _ in rows]), np.array(poses), np.array(covariances)


def _rows(
    path: Path,
    topic: str | None,
    known: dict[str, Any],
    key: str,
    read: Callable[[str, Any], Row],
    parts_of: Callable[[Any], Sequence[Any]] = lambda message: (message,),
) -> list[tuple[float, Row]]:
    """Time and content of every message of a topic, in order of time. Raises InputError if there are none.

    read: what a message of a kind holds. parts_of: messages that a message combines.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(f"{path}: reading it needs rosbags; pip install 'turnscope[ros]'") from error
    if not path.exists():
        raise InputError(f"{path}: no such file")
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            kinds = {item.topic: item.msgtype.rpartition("/")[2] for item in reader.connections}
            chosen = _chosen(path, topic, kinds, known, key)
            rows = []
            for connection, recorded_ns, raw in reader.messages(
                connections=[item for item in reader.connections if item.topic == chosen]
            ):
                message = reader.deserialize(raw, connection.msgtype)
                rows += [(_time_s(part, recorded_ns), read(kinds[chosen], part)) for part in parts_of(message)]
    except InputError:
        raise
    except Exception as error:  # rosbags, its databases and messages of a damaged recording raise anything
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: not a readable ROS recording ({reason})") from error
    if not rows:
        raise InputError(f"{path}: topic {chosen} has no message{' of this frame' if kinds[chosen] == FRAMES else ''}")
    return sorted(rows, key=lambda row: row[0])


def _chosen(path: Path, topic: str | None, kinds: dict[str, str], known: dict[str, Any], key: str) -> str:
    """The stated topic, or the only one of a supported kind. Raises InputError."""
    able = [name for name, kind in kinds.items() if kind in known]
    listed = ", ".join(f"{name} ({kinds[name]})" for name in sorted(able)) or "none"
    if topic is None:
        plain = [name for name in able if kinds[name] != FRAMES] or able
        if len(plain) == 1:
            return plain[0]
        raise InputError(f"{path}: say [commands] {key} in experiment.toml; topics that fit: {listed}")
    if topic not in kinds:
        raise InputError(f"{path}: there is no topic {topic} ([commands] {key}); topics that fit: {listed}")
    if topic not in able:
        raise InputError(
            f"{path}: topic {topic} holds {kinds[topic]}; [commands] {key} needs {', '.join(known)} (found: {listed})"
        )
    return topic


def _time_s(message: Any, recorded_ns: int) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and (stamp.sec or stamp.nanosec):
        return float(stamp.sec) + S_PER_NS * float(stamp.nanosec)
    return S_PER_NS * recorded_ns


def _of_velocity(twist: Any, topics: Topics, where: str) -> tuple[float, float]:
    if topics.wheel_radius_m is None or topics.track_m is None:
        raise InputError(
            f"{where} holds velocities; give wheel_radius_m and track_m of the robot's controller in [commands]"
        )
    ahead, turn = float(twist.linear.x), float(twist.angular.z) * topics.track_m / 2
    return (ahead - turn) / topics.wheel_radius_m, (ahead + turn) / topics.wheel_radius_m


def _of_joints(state: Any, topics: Topics, where: str) -> tuple[float, float]:
    speeds = dict(zip(state.name, state.velocity, strict=False))

    def side(key: str, joints: Joints | None) -> float:
        names = (joints,) if isinstance(joints, str) else joints or ()
        missing = [name for name in names if name not in speeds]
        if missing or not names:
            said = f"there is no velocity of {', '.join(missing)}" if missing else f"say {key} in [commands]"
            raise InputError(f"{where}: {said}; its joints are {', '.join(state.name)}")
        return float(np.mean([speeds[name] for name in names]))

    return side("left_joint", topics.left_joint), side("right_joint", topics.right_joint)


def _of_numbers(array: Any, topics: Topics, where: str) -> tuple[float, float]:
    del topics
    if len(array.data) != 2:
        raise InputError(f"{where} holds {len(array.data)} numbers; two are needed, left and right in rad/s")
    return float(array.data[0]), float(array.data[1])


def heading_rad(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Heading of a body's x axis over the plane of x and y, from a quaternion (numbers, or arrays of them)."""
    return np.asarray(np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))


def _pose(stated: Any) -> tuple[Array, Array]:
    """Pose (3,) and covariance (3, 3) of a PoseWithCovariance, or of a Pose, which states none."""
    pose = getattr(stated, "pose", stated)
    at, q = pose.position, pose.orientation
    covariance = np.full((3, 3), np.nan)
    full = np.array(getattr(stated, "covariance", ()), dtype=float).reshape(-1)
    if len(full) == 36 and full[0] > 0:  # zeros, or -1 first, mean unknown by the definitions of these messages
        covariance = full.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    return np.array([at.x, at.y, heading_rad(q.x, q.y, q.z, q.w)], dtype=float), covariance


def _of_frame(path: Path, message: Any, frame: str | None) -> Sequence[Any]:
    """The transforms of a frame in a TFMessage; any other message itself. Raises InputError if no frame is said."""
    if not hasattr(message, "transforms"):
        return (message,)
    frames = sorted({item.child_frame_id for item in message.transforms})
    if frame is None and frames:
        raise InputError(
            f"{path}: say [commands] poses_frame, the frame of the robot; the first are {', '.join(frames)}"
        )
    return [item for item in message.transforms if item.child_frame_id == frame]


def _placed(message: Any) -> SimpleNamespace:
    """A TransformStamped as a Pose."""
    return SimpleNamespace(position=message.transform.translation, orientation=message.transform.rotation)


COMMANDS: dict[str, Callable[[Any, Topics, str], tuple[float, float]]] = {
    "Twist": _of_velocity,
    "TwistStamped": lambda message, topics, where: _of_velocity(message.twist, topics, where),
    "JointState": _of_joints,
    "Float32MultiArray": _of_numbers,
    "Float64MultiArray": _of_numbers,
}
POSES: dict[str, Callable[[Any], Any]] = {
    "Odometry": lambda message: message.pose,
    "PoseWithCovarianceStamped": lambda message: message.pose,
    "PoseStamped": lambda message: message.pose,
    "TransformStamped": _placed,
    FRAMES: _placed,
}
