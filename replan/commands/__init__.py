"""The command line: one small dataclass per command, light to import; the work is imported when it is run."""

from replan.commands.bench import Bench
from replan.commands.camera import Camera
from replan.commands.doctor import Doctor
from replan.commands.perceive import Perceive
from replan.commands.record import Record
from replan.commands.robot import Robot
from replan.commands.ros2 import Ros2
from replan.commands.router import Router
from replan.commands.run import Run
from replan.commands.security import Security
from replan.commands.validate import Validate

COMMANDS = {
    "run": Run,
    "validate": Validate,
    "perceive": Perceive,
    "record": Record,
    "robot": Robot,
    "camera": Camera,
    "router": Router,
    "security": Security,
    "ros2": Ros2,
    "doctor": Doctor,
    "bench": Bench,
}
