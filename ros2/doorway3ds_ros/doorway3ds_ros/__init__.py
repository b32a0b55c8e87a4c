"""The node of doorway3ds as a ROS 2 package."""
