"""Processes on the robot's side, and acts upon them: simulated cell, Panda, cameras, router, ROS 2, recording."""
