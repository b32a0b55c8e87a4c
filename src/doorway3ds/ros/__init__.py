"""ROS: messages, bags and the node. Conversions need no ROS; the node needs the extra `ros`."""
