"""The arm and its gripper: published limits, profiles, kinematics, rigid-body dynamics. Imports no other room."""
