"""Recordings of ROS to spoil, where rosbags is installed: poses and commands in an MCAP file and in a database."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

BAGS = ("run.mcap", "run.db3")
ROS = """format = 1
name = "a recording of ROS"
robot = "barrel"
[commands]
topic = "/wheels"
poses_topic = "/odom"
[[run]]
id = "r01"
commands = "run.mcap"
poses = "run.mcap"
"""


def has_rosbags() -> bool:
    """Whether recordings of ROS can be read and written."""
    return find_spec("rosbags") is not None


def write_bags(folder: Path) -> None:
    """Write BAGS, and ros.toml, an experiment with one of them, into a folder."""
    from rosbags.rosbag2 import StoragePlugin

    from tests.evaluator.workflow.ros import bag, numbers, odometry

    for name, storage in zip(BAGS, (StoragePlugin.MCAP, StoragePlugin.SQLITE3), strict=True):
        written = folder / f"{name}.folder"
        with bag(written, storage) as send:
            for k in range(8):
                send("/odom", k / 10, odometry(k / 10, k / 1000, 0.0, k / 100))
            for at_s, left, right in ((0.0, 1.0, 2.0), (0.3, -1.0, 2.0), (0.6, 0.0, 0.0)):
                send("/wheels", at_s, numbers(left, right))
        (file,) = written.glob(f"*{Path(name).suffix}")
        file.rename(folder / name)
        shutil.rmtree(written)
    (folder / "ros.toml").write_text(ROS, encoding="utf-8")
