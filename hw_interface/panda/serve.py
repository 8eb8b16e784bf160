"""The loop of a supervisor: answer requests, then let the driver look and go on, a few hundred times a second."""

import time

from hw_interface.cell.node import RobotNode
from hw_interface.cell.pacing import FAREWELL_TIME, FROZEN_AFTER, Leash
from hw_interface.panda.driver import PandaDriver

TURN = 0.003  # [s] between two looks at the player
END_REST = 5.0  # [s] that a motion may take to rest when the process is told to end


def supervise(driver: PandaDriver, node: RobotNode, leash: Leash) -> None:
    """Run until the leash ends it; a motion is brought to rest on its path first."""
    mark = time.monotonic()
    while not leash.ended():
        node.serve(min(TURN, node.state_period))
        now = time.monotonic()
        if now - mark > FROZEN_AFTER and driver.moving:
            driver.reflex("frozen", f"the supervisor stood still for {now - mark:.1f} s in a motion")
        mark = now
        driver.tick()
    if driver.moving:
        driver.stop()
    until = time.monotonic() + END_REST
    while driver.moving and time.monotonic() < until:
        node.serve(TURN)
        driver.tick()
    until = time.monotonic() + FAREWELL_TIME
    while (left := until - time.monotonic()) > 0.0:
        node.serve(min(left, TURN))
