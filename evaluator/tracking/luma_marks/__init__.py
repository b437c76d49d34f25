"""Marks that luma alone shows: tags (ArUco, AprilTag) and lights."""
