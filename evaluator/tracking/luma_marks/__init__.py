"""Marks found in the luma: tags (ArUco, AprilTag) and lights."""
