"""The safety table: one place for every number that a motion is judged by. Needs numpy only.

The same definitions cost the motion search and judge the verdict. A reasoner can neither name, weigh nor remove
them; a cell file may change the numbers.
"""

from dataclasses import dataclass, field

from control.seen_volume import UnseenPolicy


@dataclass(frozen=True)
class SafetyLimits:
    """Limits of a motion.

    Attributes:
        velocity_scale: Share of the published joint velocity limits that may be used, 0..1.
        acceleration_scale: Share of the published joint acceleration limits that may be used, 0..1.
        joint_margin: Distance kept from each joint position limit in [rad].
        hand_speed: Highest speed of the tool centre point in the world in [m/s].
        hand_angular_speed: Highest angular speed of the hand in [rad/s].
        self_clearance: Least distance between parts of the arm that are not neighbours in [m].
        arm_clearance: Least distance between arm or hand and anything in the world while moving freely in [m].
        held_clearance: Least distance between a carried object and the world in transit in [m].
        finger_clearance: Least distance between open fingers and things that are not to be grasped in [m].
        contact_force: Highest contact force anywhere but on the fingers and the object they handle in [N].
        pressing_force: Highest force in [N] with which fingers or what they handle may press on anything else: no more
            than they grasp with, beyond which a thing slides between them.
        moved: Furthest that an object which the subtask does not name may be displaced in [m].
        tipped: Furthest that such an object may be tilted in [rad].
        settle_time: Time over which the result must hold still at the end in [s].
        settle_speed: Speed below which an object counts as still in [m/s].
        start_tolerance: Largest difference per joint between a trajectory's first sample and the robot in [rad].
        workspace_low, workspace_high: Corners of the box, in the world in [m], that the hand must stay in, shape (3,).
        keep_out: Boxes (low corner, high corner) in the world in [m] that no moving part of the robot may enter.
        unseen: What becomes of ways through space that nobody saw: "allow" takes no notice, "avoid" prefers others,
            "refuse" judges them by the next two limits.
        unseen_volume: Largest share of the swept volume, 0..1, that nobody saw and where something that stands could
            be. Above an open table less than 1 % stays hidden; ways around furniture have 7 to 42 %.
        unseen_overhead: The same of space above what was seen to be free, where only what hangs or floats can be.
        look_first: Under "avoid", the hidden share of a way, 0..1, from which on a wrist camera looks there before the
            motion is played. A look takes as long as a motion; only ways around furniture have so large a share.
    """

    velocity_scale: float = 0.8
    acceleration_scale: float = 0.5
    joint_margin: float = 0.02
    hand_speed: float = 0.5
    hand_angular_speed: float = 2.0
    self_clearance: float = 0.005
    arm_clearance: float = 0.012
    held_clearance: float = 0.004
    finger_clearance: float = 0.002
    contact_force: float = 15.0
    pressing_force: float = 40.0
    moved: float = 0.02
    tipped: float = 0.26
    settle_time: float = 0.5
    settle_speed: float = 0.01
    start_tolerance: float = 0.005
    workspace_low: tuple[float, float, float] = (-0.2, -0.8, 0.0)
    workspace_high: tuple[float, float, float] = (0.9, 0.8, 1.3)
    keep_out: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = field(default=())
    unseen: UnseenPolicy = "avoid"
    unseen_volume: float = 0.05
    unseen_overhead: float = 1.0
    look_first: float = 0.3
