"""The cell as ROS 2 sees it: messages in its own encoding, on its bridges' keys or in recordings. Needs no ROS."""
