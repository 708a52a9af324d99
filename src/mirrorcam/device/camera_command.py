"""`mirrorcam camera`: the library of cameras with the sources of its figures, new cameras, and mirrors as cameras."""

from __future__ import annotations

import glob
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.optics.geometry.camera_library import MAX_DISAGREEMENT, CameraProfile, library, read_profile

app = App(name="camera")
HELD_BY = {
    "lips": "its body: a tray with sprung screws, or ties",
    "board": "screws through its board",
    "threads": "screws in its own threads",
}
"""How the clip holds a camera, by `held_by.kind`."""


@app.command(name="list")
def list_cameras() -> int:
    """List the cameras in the library.

    Prints their optics and bodies, and the numbers of figures that are guessed or recalled from memory.
    """
    print_table(("name", "picture", "view, deg", "pupil", "guessed", "recalled", "camera"), list_rows())
    return 0


@app.command
def show(
    name: Annotated[str, Parameter(name="NAME", help="a name that mirrorcam camera list prints, or a TOML file")], /
) -> int:
    """Show everything about a camera.

    Prints its optics and body, the sources of the figures, and the guesses.

    Examples:
        mirrorcam camera show c920
    """
    for title, text in described(read_profile(name)):
        say(title, text)
    return 0


@app.command
def new(
    file: Annotated[Path, Parameter(name="FILE", help="file to write, such as my_camera.toml")],
    /,
    *,
    like: Annotated[
        str,
        Parameter(metavar="NAME", help="similar camera of the library, whose figures become the defaults"),
    ] = "c920",
) -> int:
    """Measure a camera of your own.

    Asks for each dimension, draws where to measure it, and writes the file.

    Examples:
        mirrorcam camera new my_camera.toml --like c920
    """
    from mirrorcam.device.new_camera import write_new_camera

    require("cad")
    profile = write_new_camera(file, read_profile(like), input, lambda line: say("camera", line))
    say("camera", f"{profile.name}: {file} written; next: mirrorcam design --camera {file}")
    return 0


@app.command
def export(
    layout: Annotated[
        Path,
        Parameter(name="LAYOUT|CAMERA", help="layout.json, calibrated if possible, or camera.json of a bare camera"),
    ],
    /,
    *,
    pictures: Annotated[
        tuple[Path, ...],
        Parameter(help="frames of the camera, or folders of them, to write flipped and masked for COLMAP"),
    ] = (),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/cameras"),
    force: Force = False,
) -> int:
    """Export every mirror, or a camera without mirrors, as a camera for other tools.

    Writes files for OpenCV, ROS, Kalibr, COLMAP, nerfstudio, URDF, Anipose and DeepLabCut (of a camera without
    mirrors, for OpenCV, ROS, Kalibr and Anipose); README.md explains them.

    Examples:
        mirrorcam camera export calibrated/layout.json --pictures through_mirrors/
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.images.picture_data import EXPECTED
    from mirrorcam.core.images.pictures import is_picture, pictures_in
    from mirrorcam.optics.camera_files.write.write_exports import (
        PLAIN_FILES,
        export_names,
        write_exports,
        write_plain_exports,
    )
    from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera, is_calibrated_camera
    from mirrorcam.optics.geometry.layout import Layout

    if is_calibrated_camera(layout):
        if pictures:
            raise InputError("--pictures needs a layout, expected none with a camera without mirrors")
        camera = CalibratedCamera.load(layout).camera
        with output_folder(out, "cameras", force=force) as output:
            output.refuse_others("README.md", *PLAIN_FILES.values())
            with output.staged() as folder:
                write_plain_exports(camera, folder)
        say("camera", f"files for {', '.join(PLAIN_FILES)} written to {out}")
        return 0
    device, paths = Layout.load(layout), pictures_in(pictures, lambda line: say("camera", line))
    for path in paths:
        if not is_picture(path):
            raise InputError(f"{path}: not a picture, expected {EXPECTED} frames or folders of them, not videos")
    with output_folder(out, "cameras", force=force) as output:
        output.refuse_others(*(glob.escape(name) for name in export_names(device, paths)))
        with output.staged() as folder:
            write_exports(device, folder, paths)
    tools = "OpenCV, ROS, Kalibr, COLMAP, nerfstudio, URDF, Anipose and DeepLabCut"
    say("camera", f"files for {tools} written to {out}")
    return 0


def list_rows() -> list[tuple[str, ...]]:
    """A row of texts for each camera of the library: name, picture, field of view, pupil, guesses, recalled, title.

    Recalled sources are those cited from memory, without reading them again.
    """
    rows: list[tuple[str, ...]] = []
    for name, profile in library().items():
        optics, view = profile.optics, profile.body.field_of_view_deg
        picture = f"{optics.width_px} x {optics.height_px}" if optics else "any lens"
        degrees = " x ".join(f"{angle:.1f}" for angle in view) if view else "-"
        pupil = f"{optics.aperture_mm:.2f} mm" if optics else "-"
        recalled = sum(source.from_memory for source in profile.sources)
        recalled_text = f"{recalled} of {len(profile.sources)}"
        rows.append((name, picture, degrees, pupil, str(len(_guesses(profile))), recalled_text, profile.name))
    return rows


def described(profile: CameraProfile) -> list[tuple[str, str]]:
    """Lines (title, text) about a camera: optics, body, published, guessed and rejected figures, and sources."""
    body, optics = profile.body, profile.optics
    lines = [("camera", profile.name)]
    if optics is not None:
        size = f"{optics.width_px} x {optics.height_px} px, focal length {optics.fx_px:.1f} px"
        view = " x ".join(f"{angle:.1f}" for angle in body.field_of_view_deg or ())
        lines += [
            *([("mode", profile.mode)] if profile.mode else []),
            ("optics", f"{size}, {view} deg, pupil {optics.aperture_mm:g} mm, in focus at {optics.focus_mm:g} mm"),
        ]
    lines.append(("body", f"{body.width_mm:g} x {body.height_mm:g} x {body.depth_mm:g} mm, {body.mass_g:g} g"))
    position = f"{body.lens_x_mm:+g}, {body.lens_y_mm:+g} mm from the centre of the body"
    lines.append(("lens", f"{position}, pupil {body.pupil_behind_front_mm:g} mm behind its front"))
    lines.append(("held by", HELD_BY[body.held_by.kind]))
    for name, relative in profile.disagreements.items():
        stated = f"{name} {getattr(profile.published, name):g}"
        reason = profile.set_aside.get(name, "" if abs(relative) <= MAX_DISAGREEMENT else "not followed")
        lines.append(("published", f"{stated}; here {relative:+.1%}{': ' if reason else ''}{reason}"))
    if guesses := _guesses(profile):
        lines.append(("guessed", f"{', '.join(guesses)}: measure these on your camera"))
    for source in profile.sources:
        recalled = " (from memory)" if source.from_memory else ""
        lines.append(("source", f"{source.title}, {source.url}: {source.gives}{recalled}"))
    if profile.notes:
        lines.append(("note", profile.notes))
    return lines


def _guesses(profile: CameraProfile) -> list[str]:
    return [*profile.guessed, *profile.body.guessed]
