"""Decoded light fields in rerun's viewer: views at their positions in space, depth, and points.

The scene is in the view frame, in metres: x right, y down, z forward from the reference view.
"""

from __future__ import annotations

import os
import shutil
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam import LightField
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.messages import shortened
from mirrorcam.optics.light_field.depth import DepthMap
from mirrorcam.optics.light_field.io.ros_messages import M_FROM_MM, depth_m, points_m, view_topic
from mirrorcam.optics.light_field.io.view_images import rgb
from mirrorcam.optics.light_field.light_field import Views

SCENE, DEPTH, TIME = "light_field", "depth", "frame_time"
PORT = 9876
"""Port on which the viewer listens."""
WAIT_S = 5.0
IMAGE_PLANE_M = 0.02
"""Distance in front of a view at which its picture is drawn."""
CORNER_PX = 0.5
"""In rerun, (0, 0) is the corner of the picture, not the centre of its first pixel."""


class RerunViewer:
    """Shows frames one by one on a recording of rerun.

    Parameters
    ----------
    recording
        A `rerun.RecordingStream` to a window or into a file.
    """

    def __init__(self, recording: Any) -> None:
        self._recording = recording
        self._views: Views | None = None

    @classmethod
    def opened(cls) -> RerunViewer:
        """Connect to the viewer that listens on this machine, else open one in a window.

        Raises InputError if rerun is not installed, or if no viewer can be opened.
        """
        require("view")
        import rerun

        recording = rerun.RecordingStream("mirrorcam")
        try:
            if not _listens():
                _open_window()
            recording.connect_grpc(f"rerun+http://127.0.0.1:{PORT}/proxy")
        except InputError:
            recording.disconnect()
            raise
        return cls(recording)

    def show(self, time_s: float, light_field: LightField, depth: DepthMap | None) -> None:
        """Show a frame at its time, with its depth, if any."""
        import rerun

        recording = self._recording
        if self._views is None or not np.array_equal(self._views.matrices, light_field.matrices):
            self._show_cameras(light_field)
        recording.set_time(TIME, duration=time_s)
        for view in np.ndindex(light_field.rows, light_field.cols):
            recording.log(f"{SCENE}/{view_topic(view)}", rerun.Image(_picture(light_field, view)))
        if depth is not None:
            recording.log(DEPTH, rerun.DepthImage(depth_m(depth), meter=1.0))
            points = points_m(depth)
            valid = np.isfinite(points[..., 2])
            colours = rgb(light_field.samples[depth.view])[valid]
            recording.log(f"{SCENE}/points", rerun.Points3D(points[valid], colors=colours))

    def _show_cameras(self, views: Views) -> None:
        """Show the positions of the views, and arrange the panes: the scene, the reference view and its depth."""
        import rerun
        import rerun.blueprint as rrb

        self._views = views
        self._recording.log(SCENE, rerun.ViewCoordinates.RDF, static=True)
        for view in np.ndindex(views.rows, views.cols):
            matrix = views.matrices[view].copy()
            matrix[:2, 2] += CORNER_PX
            position_m = views.positions_mm[view] * M_FROM_MM
            pinhole = rerun.Pinhole(
                image_from_camera=matrix,
                resolution=(views.width_px, views.height_px),
                image_plane_distance=IMAGE_PLANE_M,
            )
            self._recording.log(
                f"{SCENE}/{view_topic(view)}", rerun.Transform3D(translation=position_m), pinhole, static=True
            )
        t, s = (int(index) for index in np.argwhere((views.positions_mm == 0).all(axis=2))[0])
        self._recording.send_blueprint(
            rrb.Blueprint(
                rrb.Horizontal(
                    rrb.Spatial3DView(origin=SCENE),
                    rrb.Vertical(
                        rrb.Spatial2DView(origin=f"{SCENE}/{view_topic((t, s))}"), rrb.Spatial2DView(origin=DEPTH)
                    ),
                )
            )
        )


def _listens() -> bool:
    """Return whether a viewer listens on this machine, or on another through a tunnel."""
    try:
        socket.create_connection(("127.0.0.1", PORT), timeout=WAIT_S).close()
    except OSError:
        return False
    return True


def _open_window() -> None:
    """Open a viewer in a window; raises InputError if that fails."""
    import rerun

    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            "--view opens a window, but there is no display: expected one, or a rerun viewer that listens on port "
            f"{PORT}"
        )
    # If Python was started by its path, the folder of its scripts may be missing from PATH.
    folders = (str(Path(sys.executable).parent), os.environ.get("PATH", ""))
    program = shutil.which("rerun", path=os.pathsep.join(folders))
    reason = "it ended at once"
    try:
        rerun.spawn(connect=False, executable_path=program, port=PORT)
    except (OSError, RuntimeError) as error:
        reason = " ".join(str(error).split())
    # Rerun only warns of a viewer that ends at once, for example without graphics.
    if not _listens():
        raise InputError(shortened(f"--view: rerun's viewer does not start: {reason}"))


def _picture(light_field: LightField, view: tuple[int, int]) -> Any:
    """A view (h, w, 3) in RGB, or (h, w) in grey."""
    samples = light_field.samples[view]
    return samples[..., 0] if samples.shape[-1] == 1 else samples
