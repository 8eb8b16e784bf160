"""`replan camera zed|realsense|uvc|recording`: one camera in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from replan.commands.flags import SetOnly, options_in
from replan.robot.options import CameraOptions

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class CameraZed(CameraOptions):
    """A Stereolabs ZED: the left picture and its depth. Needs the ZED SDK, which brings its own Python package."""

    serial: int | None = None
    """Serial number. Default: the first camera that there is."""
    resolution: Literal["VGA", "HD720", "HD1080", "HD1200", "HD2K"] = "HD720"
    """Picture size; which of them there are depends on the model."""
    fps: int = 30
    """Pictures a second."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Offer it until Ctrl-C."""
        from hw_interface.cameras.zed import ZedSource
        from replan.robot.camera_process import serve_device

        open_source = lambda _: ZedSource(self.serial, self.resolution, self.fps)  # noqa: E731
        return _told(console, serve_device(options_in(self, CameraOptions), open_source, console.note))


@dataclass(frozen=True, kw_only=True)
class CameraRealSense(CameraOptions):
    """An Intel RealSense of the D400 family or later: colour, and depth laid over it."""

    serial: str | None = None
    """Serial number. Default: the only camera that there is."""
    width: int = 640
    """Picture width in [px]."""
    height: int = 480
    """Picture height in [px]."""
    fps: int = 30
    """Pictures a second."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Offer it until Ctrl-C."""
        from hw_interface.cameras.realsense import RealSenseSource
        from replan.robot.camera_process import serve_device

        open_source = lambda _: RealSenseSource(self.serial, self.width, self.height, self.fps)  # noqa: E731
        return _told(console, serve_device(options_in(self, CameraOptions), open_source, console.note))


@dataclass(frozen=True, kw_only=True)
class CameraUvc(CameraOptions):
    """Any other camera, colour only: nothing can be located with it, as it measures no depth.

    For films, recordings and pictures shown to language models. `replan run` refuses to look with it alone.
    """

    cell: str = CameraOptions.cell
    """Built-in cell or cell file (YAML) that says where the camera is, and its lens."""
    device: str = "0"
    """Its number, or a path such as /dev/v4l/by-id/..."""
    intrinsics: Path | None = None
    """Intrinsics file (YAML or JSON: width, height, fx, fy, cx, cy). Default: as the cell file says."""
    fps: int = 30
    """Pictures a second."""
    latency: float = 0.05
    """From exposure to when a picture comes, in [s]; such cameras do not tell."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Offer it until Ctrl-C."""
        from hw_interface.cameras.uvc import UvcSource
        from perception.recordings.intrinsics_file import read_intrinsics
        from replan.robot.camera_process import serve_device

        lens = None if self.intrinsics is None else read_intrinsics(self.intrinsics).intrinsics
        device = int(self.device) if self.device.isdecimal() else self.device
        open_source = lambda camera: UvcSource(device, lens or camera.intrinsics, self.fps, self.latency)  # noqa: E731
        return _told(console, serve_device(options_in(self, CameraOptions), open_source, console.note))


@dataclass(frozen=True, kw_only=True)
class CameraRecording(CameraOptions):
    """A recording in the place of a camera, stamped as if its pictures were taken now. For trying things out.

    What it shows is not what stands before the robot: never use it with a real arm.
    """

    path: tyro.conf.Positional[Path]
    """Folder of PNG pairs, BOP scene, .mcap or .npz, as `replan perceive` reads them."""
    cell: tyro.conf.Suppress[str] = CameraOptions.cell
    camera: str | None = None
    """Which camera of the recording. Default: that of its first picture."""
    intrinsics: Path | None = None
    """Intrinsics file, where the recording carries none."""
    loop: SetOnly = False
    """Begin again at the end."""
    every_frame: SetOnly = False
    """Give each picture to one request, in order, instead of at the pace that they were recorded at."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Offer it until Ctrl-C, or until it has ended."""
        from hw_interface.cameras.recorded import RecordedSource
        from perception.recordings.opening import open_recording
        from replan.robot.camera_process import serve_recording

        recording = open_recording(self.path, self.intrinsics)
        source = RecordedSource(recording, self.camera, paced=not self.every_frame, loop=self.loop)
        name = self.name or source.camera
        done = serve_recording(options_in(self, CameraOptions), source, name, self.every_frame, console.note)
        return _told(console, done)


@dataclass(frozen=True)
class Camera:
    """One camera in a process of its own: a ZED, a RealSense, any other, or a recording in its place."""

    which: tyro.conf.OmitSubcommandPrefixes[
        tyro.conf.OmitArgPrefixes[
            Annotated[CameraZed, tyro.conf.subcommand("zed")]
            | Annotated[CameraRealSense, tyro.conf.subcommand("realsense")]
            | Annotated[CameraUvc, tyro.conf.subcommand("uvc")]
            | Annotated[CameraRecording, tyro.conf.subcommand("recording")]
        ]
    ]

    @property
    def json(self) -> bool:
        """Whether the chosen command prints JSON."""
        return self.which.json

    def execute(self, console: Console) -> int:
        """Run the chosen command."""
        return self.which.execute(console)


def _told(console: Console, done: dict[str, Any]) -> int:
    why = f" ({done['ended']})" if done["ended"] else ""
    console.result(done, f"camera '{done['camera']}' ended{why}: {done['frames']} pictures, {done['dropped']} dropped")
    return 0
