"""A thread that owns a source and keeps its newest picture only, so that nobody is ever given one from a queue."""

import threading
import time
from collections import deque
from collections.abc import Callable

from control.errors import RefusedError
from hw_interface.cameras.source import CameraFailedError, CameraSource, Shot
from perception.errors import PerceptionError

RATE_WINDOW = 5.0  # [s]
GAP = 1.5  # times the usual time between pictures; more, where the device does not number them, is a dropped one
DEFAULT_MAX_AGE = 0.5  # [s]


class Capture:
    """Reads a source on a thread of its own until closed or until it fails.

    Args:
        source: The source; this class closes it.
        camera: Name of the camera, for messages.
        max_age: How old a picture may be in [s].
        wall: This computer's wall clock in [s], which pictures are stamped by.

    Attributes:
        frames: Pictures that came.
        dropped: Pictures that the device took and that did not come, by its numbers or by gaps between stamps.
        failure: Why there are no more pictures; None while there are.
    """

    def __init__(
        self,
        source: CameraSource,
        camera: str,
        max_age: float = DEFAULT_MAX_AGE,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self._source = source
        self._camera = camera
        self._max_age = max_age
        self._wall = wall
        self._news = threading.Condition()
        self._newest: Shot | None = None
        self._arrivals: deque[float] = deque()
        self._gaps: deque[float] = deque(maxlen=15)
        self._begun = time.monotonic()
        self._closed = False
        self.frames = 0
        self.dropped = 0
        self.failure: CameraFailedError | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def taken_now(self) -> Shot:
        """The first picture that was exposed after this call; waits for it, but no longer than a picture may be old.

        Raises:
            RefusedError: stale_frame: none came; says how old the newest is. camera_failed: there will be none.
        """
        asked = self._wall()
        until = time.monotonic() + self._max_age
        with self._news:
            while True:
                if self.failure is not None:
                    raise RefusedError("camera_failed", f"camera '{self._camera}' gives no pictures: {self.failure}")
                if self._newest is not None and self._newest.frame.stamp >= asked:
                    break
                left = until - time.monotonic()
                if left <= 0.0:
                    raise RefusedError("stale_frame", self._stale())
                self._news.wait(left)
            newest = self._newest
        age = self._wall() - newest.frame.stamp
        if age > self._max_age:
            raise RefusedError("stale_frame", self._stale())
        return newest

    def age(self) -> float | None:
        """How old the newest picture is in [s]; None before the first."""
        with self._news:
            return None if self._newest is None else self._wall() - self._newest.frame.stamp

    def rate(self) -> float:
        """Pictures a second over the last `RATE_WINDOW`."""
        now = time.monotonic()
        with self._news:
            recent = [t for t in self._arrivals if now - t <= RATE_WINDOW]
        return len(recent) / min(RATE_WINDOW, max(now - self._begun, 1e-3))

    def close(self) -> None:
        """Stop reading and close the source."""
        self._closed = True
        self._thread.join(5.0)  # a device that hangs must not keep the process

    def _stale(self) -> str:
        newest = self._newest
        how = "none has come yet" if newest is None else f"the newest is {self._wall() - newest.frame.stamp:.2f} s old"
        return (
            f"camera '{self._camera}' has no picture that was taken after it was asked for one: {how}; it has "
            f"{self._max_age:g} s for that: see whether the device runs, or raise --max-age for a slow one"
        )

    def _run(self) -> None:
        try:
            while not self._closed:
                self._take(self._source.read())
        except CameraFailedError as error:
            self._fail(error)
        except (PerceptionError, OSError, RuntimeError, ValueError) as error:
            self._fail(CameraFailedError(f"{type(error).__name__}: {error}"))
        finally:
            self._source.close()

    def _take(self, shot: Shot) -> None:
        with self._news:
            self.dropped += self._missing(shot)
            self.frames += 1
            self._newest = shot
            now = time.monotonic()
            self._arrivals.append(now)
            while now - self._arrivals[0] > RATE_WINDOW:
                self._arrivals.popleft()
            self._news.notify_all()

    def _missing(self, shot: Shot) -> int:
        """How many pictures were taken between the one before and this one."""
        before = self._newest
        if before is None:
            return 0
        if shot.number is not None and before.number is not None:
            return max(0, shot.number - before.number - 1)
        gap = shot.frame.stamp - before.frame.stamp
        usual = sorted(self._gaps)[len(self._gaps) // 2] if len(self._gaps) >= 5 else None
        self._gaps.append(gap)
        return 0 if usual is None or usual <= 0.0 or gap < GAP * usual else round(gap / usual) - 1

    def _fail(self, error: CameraFailedError) -> None:
        with self._news:
            self.failure = error
            self._news.notify_all()


class OnRequest:
    """Reads a source when it is asked to, for recordings of which each picture is wanted; as `Capture`.

    Args:
        source: The source; this class closes it.
        camera: Name of the camera, for messages.
    """

    def __init__(self, source: CameraSource, camera: str) -> None:
        self._source = source
        self._camera = camera
        self._stamp: float | None = None
        self.frames = 0
        self.dropped = 0
        self.failure: CameraFailedError | None = None

    def taken_now(self) -> Shot:
        """The next picture.

        Raises:
            RefusedError: camera_failed: there is none.
        """
        if self.failure is None:
            try:
                shot = self._source.read()
            except CameraFailedError as error:
                self.failure = error
            else:
                self.frames, self._stamp = self.frames + 1, shot.frame.stamp
                return shot
        raise RefusedError("camera_failed", f"camera '{self._camera}' gives no pictures: {self.failure}")

    def age(self) -> float | None:
        """How old the newest picture is in [s]; None before the first."""
        return None if self._stamp is None else time.time() - self._stamp

    def rate(self) -> float:
        """Pictures a second: there is no rate."""
        return 0.0

    def close(self) -> None:
        """Close the source."""
        self._source.close()
