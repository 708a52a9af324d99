"""`mirrorcam camera`: the library of cameras, with the sources of its figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.extras import require
from mirrorcam.core.values import Value
from mirrorcam.device.new_camera import write_new_camera
from mirrorcam.optics.geometry.camera_library import AGREE, CameraProfile, library, read_profile


class CameraOptions(Value):
    """Show the cameras that the program knows: their optics and bodies, where the figures come from, what is guessed.

    For each mirror of a layout as a camera, see mirrorcam cameras.
    """

    action: tyro.conf.Positional[Literal["list", "show", "new"]] = Field(
        description="list: all cameras; show: everything about one; new: measure your own, and write its file"
    )
    name: tyro.conf.Positional[Annotated[str | None, tyro.conf.arg(metavar="[NAME|PATH]", help_behavior_hint="")]] = (
        Field(
            default=None,
            description="camera to show: a name in the list, or a TOML file like theirs; new: the file to write",
        )
    )

    like: str = Field(
        default="c920", description="new: a camera that is like yours, whose figures are offered: held by body or board"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.action == "show" and self.name is None:
            raise ValueError("camera show: expected the name of a camera, as `mirrorcam camera list` prints them")
        if self.action == "new" and self.name is None:
            raise ValueError("camera new: expected the file to write, such as my_camera.toml")
        if self.action == "list" and self.name is not None:
            raise ValueError(f"camera list {self.name}: expected no name, or camera show {self.name}")
        return self


def run(options: CameraOptions) -> int:
    """Print the list of cameras, or all about one of them, or ask for the measures of a new one."""
    if options.action == "new" and options.name is not None:
        require("cad")
        profile = write_new_camera(Path(options.name), read_profile(options.like), input, _show)
        say("camera", f"{profile.name}: {options.name} written; next: mirrorcam design --camera {options.name}")
        return 0
    if options.name is None:
        print_table(("name", "picture", "view, deg", "pupil", "guessed", "recalled", "camera"), list_rows())
        return 0
    for title, text in described(read_profile(options.name)):
        say(title, text)
    return 0


def _show(line: str) -> None:
    say("camera", line)


def list_rows() -> list[tuple[str, ...]]:
    """A row of texts for each camera of the library: name, picture, field of view, pupil, guesses, recalled, title.

    Recalled are sources that were not read again: their figures are from memory.
    """
    rows: list[tuple[str, ...]] = []
    for name, profile in library().items():
        optics, view = profile.optics, profile.body.field_of_view_deg
        picture = f"{optics.width_px} x {optics.height_px}" if optics else "any lens"
        degrees = " x ".join(f"{angle:.1f}" for angle in view) if view else "-"
        pupil = f"{optics.aperture_mm:.2f} mm" if optics else "-"
        recalled = sum(source.from_memory for source in profile.sources)
        known = f"{recalled} of {len(profile.sources)}"
        rows.append((name, picture, degrees, pupil, str(len(_guesses(profile))), known, profile.name))
    return rows


def described(profile: CameraProfile) -> list[tuple[str, str]]:
    """Lines (title, text) about a camera: optics, body, what was published, guessed and set aside, and sources."""
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
    where = f"{body.lens_x_mm:+g}, {body.lens_y_mm:+g} mm from the middle of the body"
    lines.append(("lens", f"{where}, pupil {body.pupil_behind_front_mm:g} mm behind its front"))
    lines.append(("held by", "lips over its front" if body.held_by.kind == "lips" else "screws through its board"))
    for name, relative in profile.disagreements.items():
        stated = f"{name} {getattr(profile.published, name):g}"
        reason = profile.set_aside.get(name, "" if abs(relative) <= AGREE else "not followed")
        lines.append(("published", f"{stated}; here {relative:+.1%}{': ' if reason else ''}{reason}"))
    if guesses := _guesses(profile):
        lines.append(("guessed", f"{', '.join(guesses)}: measure these of yours"))
    for source in profile.sources:
        read = " (from memory)" if source.from_memory else ""
        lines.append(("source", f"{source.title}, {source.url}: {source.gives}{read}"))
    if profile.notes:
        lines.append(("note", profile.notes))
    return lines


def _guesses(profile: CameraProfile) -> list[str]:
    return [*profile.guessed, *profile.body.guessed]
