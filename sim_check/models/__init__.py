"""MuJoCo models of robot, gripper, things and scene, and their rendering. May import `cells` and `objects`."""
