"""Recordings of ROS written by rosbags itself: the messages that turnscope reads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

EPOCH_S = 1_764_000_000
NS = 1_000_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
Send = Callable[[str, float, Any], None]


@contextmanager
def bag(path: Path, storage: StoragePlugin = StoragePlugin.MCAP) -> Iterator[Send]:
    """Give a function that writes a message to a topic at a time after EPOCH_S."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}

        def send(topic: str, at_s: float, message: Any) -> None:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            stamp_ns = EPOCH_S * NS + round(at_s * NS)
            writer.write(connections[topic], stamp_ns, STORE.serialize_cdr(message, kind))

        yield send


def header(at_s: float) -> Any:
    whole = int(np.floor(at_s))
    time = TYPES["builtin_interfaces/msg/Time"](sec=EPOCH_S + whole, nanosec=round((at_s - whole) * NS))
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id="map")


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return TYPES["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def twist(ahead: float, turn: float) -> Any:
    return TYPES["geometry_msgs/msg/Twist"](linear=vector(ahead), angular=vector(z=turn))


def joints(names: list[str], speeds: list[float]) -> Any:
    kind = TYPES["sensor_msgs/msg/JointState"]
    empty = np.zeros(0)
    return kind(header=header(0.0), name=names, position=empty, velocity=np.array(speeds), effort=empty)


def numbers(*values: float) -> Any:
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return TYPES["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array(values))


def odometry(at_s: float, x: float, y: float, heading: float, covariance: np.ndarray | None = None) -> Any:
    turned = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))
    pose = TYPES["geometry_msgs/msg/Pose"](TYPES["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), turned)
    full = np.zeros(36) if covariance is None else covariance.ravel()
    return TYPES["nav_msgs/msg/Odometry"](
        header=header(at_s),
        child_frame_id="base_link",
        pose=TYPES["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=full),
        twist=TYPES["geometry_msgs/msg/TwistWithCovariance"](twist=twist(0.0, 0.0), covariance=np.zeros(36)),
    )


def transform(at_s: float, x: float, y: float, heading: float, child: str = "base_link") -> Any:
    turned = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))
    return TYPES["geometry_msgs/msg/TransformStamped"](
        header=header(at_s),
        child_frame_id=child,
        transform=TYPES["geometry_msgs/msg/Transform"](translation=vector(x, y), rotation=turned),
    )


def frames(*transforms: Any) -> Any:
    return TYPES["tf2_msgs/msg/TFMessage"](transforms=list(transforms))
