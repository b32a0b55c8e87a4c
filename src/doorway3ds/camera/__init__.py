"""Cameras: intrinsics, lens distortion, pose on the robot, and pixel <-> ray <-> bearing."""
