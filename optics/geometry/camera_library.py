"""The camera library: optics and bodies of common cameras as published, with their sources.

Each camera is a TOML file in `optics/geometry/cameras/`. It holds the published figures next to the optics derived
from them, so that the two can be compared, and lists unpublished figures as guessed.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_OR_INF_MM, SENSOR_PX, Bounds
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, keys_of, model_from, model_of, read_bytes, tables_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import Line, Name
from mirrorcam.core.values import Value, with_tuples
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_body import CameraBody, ViewAngle

CAMERAS = Path(__file__).parent / "cameras"
CALIBRATED_SCHEMA = "mirrorcam.camera/1"
"""Schema of `CalibratedCamera`."""
MAX_DISAGREEMENT = 0.03
"""Largest relative difference between a published figure and the figure of the optics."""
_PIXEL_UM = Bounds(0.1, 100.0)


class Source(Value):
    """A source of figures."""

    title: Line
    url: Annotated[Line, Field(pattern=r"^https?://\S+$")]
    gives: Line = Field(description="the figures that it states")
    from_memory: bool = Field(
        default=False, description="figures were written down from memory and not checked against the source"
    )


class PublishedFigures(Value):
    """Figures of a camera as its maker states them; unpublished ones are omitted."""

    focal_mm: float | None = Bounds(0.01, 1e4).field(None, "focal length")
    f_number: float | None = Bounds(0.1, 100.0).field(None, "f-number")
    pixel_um: float | None = _PIXEL_UM.field(None, "pitch of the sensor's pixels")
    horizontal_deg: ViewAngle | None = Field(default=None, description="field of view along the image's x")
    vertical_deg: ViewAngle | None = Field(default=None, description="field of view along the image's y")
    diagonal_deg: ViewAngle | None = Field(default=None, description="field of view along the diagonal")
    view_px: tuple[Annotated[int, SENSOR_PX.limits], Annotated[int, SENSOR_PX.limits]] | None = Field(
        default=None, description="sensor pixels to which the stated field of view refers; default: the picture's"
    )
    nearest_mm: float | None = Bounds(DEPTH_OR_INF_MM.min, 1e5).field(None, "closest focus distance")


class CameraProfile(Value):
    """One camera of the library.

    Attributes
    ----------
    name : str
        Maker and model; name of optics and body.
    mode : str
        Video mode of the optics: how the picture is read from the sensor.
    sensor_px_per_px : float
        Pixels of the sensor per pixel of the picture along an axis, for binned or scaled pictures.
    optics : Camera, optional
        Optics without body; None for a board that takes lenses of any focal length.
    body : CameraBody
        Body, with the field of view of the optics.
    sources : tuple of Source
        Sources of the figures; empty for a camera that its owner measured.
    published : PublishedFigures
        The maker's figures for the optics.
    set_aside : dict
        Figures of `published` that the optics deliberately contradict, each with the reason.
    guessed : tuple of str
        Unpublished fields of `optics`; `body.guessed` lists those of the body.
    notes : str
        Further notes for users.
    """

    name: Name
    mode: Line = ""
    sensor_px_per_px: float = Bounds(0.01, 100.0).field(1.0)
    optics: Camera | None = None
    body: CameraBody
    sources: tuple[Source, ...] = ()
    published: PublishedFigures = PublishedFigures()
    set_aside: dict[str, Line] = Field(default_factory=dict)
    guessed: tuple[Name, ...] = ()
    notes: Line = ""

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, data: Any) -> Any:
        """Fill in what a file may omit: names, a centred principal point, square pixels and the field of view."""
        if not isinstance(data, dict):
            return data
        data = with_tuples(data)
        optics, body = data.get("optics"), data.get("body")
        name = {"name": data["name"]} if "name" in data else {}
        if isinstance(optics, dict):
            optics = (
                name
                | {f"c{axis}_px": (optics.get(size, 0) - 1) / 2.0 for axis, size in _AXES if _is_size(optics, size)}
                | optics
            )
            if "fx_px" in optics:
                optics = {"fy_px": optics["fx_px"]} | optics
            data["optics"] = optics
        if isinstance(body, dict):
            data["body"] = name | _view_of(optics) | body
        return data

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("body_mm", "lens_mm"):
            if getattr(self.optics, name, None) is not None:
                raise ValueError(f"optics.{name} is given, but it follows from [body]")
        if unknown := [name for name in self.guessed if self.optics is None or name not in Camera.model_fields]:
            raise ValueError(f"guessed: {unknown[0]} is not a field of the optics")
        if unknown := [name for name in self.set_aside if getattr(self.published, name, None) is None]:
            raise ValueError(f"set_aside: {unknown[0]} is not published")
        return self

    @property
    def camera(self) -> Camera:
        """The camera with the boxes around its body and lens, to design a layout for; InputError without optics."""
        if self.optics is None:
            raise InputError(f"camera {self.name}: the focal length is unknown, expected a camera with [optics]")
        return self.optics.replaced(body_mm=self.body.box_mm, lens_mm=self.body.lens_box_mm)

    @property
    def disagreements(self) -> dict[str, float]:
        """Relative difference of the optics from each published figure that can be compared."""
        if self.optics is None:
            return {}
        published, optics = self.published, self.optics
        focal = optics.fx_px * self.sensor_px_per_px
        width, height = published.view_px or (
            optics.width_px * self.sensor_px_per_px,
            optics.height_px * self.sensor_px_per_px,
        )
        sides = {"horizontal_deg": width, "vertical_deg": height, "diagonal_deg": math.hypot(width, height)}
        computed = {name: math.degrees(2.0 * math.atan(side / focal / 2.0)) for name, side in sides.items()}
        if published.pixel_um is not None:
            computed["focal_mm"] = focal * published.pixel_um / 1000.0
        if published.focal_mm is not None and optics.aperture_mm > 0.0:
            computed["f_number"] = published.focal_mm / optics.aperture_mm
        stated = {name: getattr(published, name) for name in computed}
        return {name: computed[name] / value - 1.0 for name, value in stated.items() if value is not None}


_AXES = (("x", "width_px"), ("y", "height_px"))


def _is_size(optics: dict[str, Any], name: str) -> bool:
    return type(optics.get(name)) is int and optics[name] > 0


def _view_of(optics: Any) -> dict[str, Any]:
    """Field of view along x and y of a table of optics, to a tenth of a degree; empty for an invalid table."""
    if not isinstance(optics, dict) or not all(_is_size(optics, size) for _, size in _AXES):
        return {}
    focal = [optics.get(f"f{axis}_px") for axis, _ in _AXES]
    if not all(isinstance(f, int | float) and f > 0 for f in focal):
        return {}
    sizes = (optics[size] for _, size in _AXES)
    angles = (2.0 * math.atan(size / f / 2.0) for size, f in zip(sizes, focal, strict=True))
    return {"field_of_view_deg": tuple(round(math.degrees(angle), 1) for angle in angles)}


@cache
def library() -> dict[str, CameraProfile]:
    """All cameras of the library by name, sorted."""
    return {path.stem: _profile(path) for path in sorted(CAMERAS.glob("*.toml"))}


def _profile(path: Path) -> CameraProfile:
    return model_of(CameraProfile, path, read_bytes(path, LARGEST_TEXT_BYTES))


def camera_names() -> tuple[str, ...]:
    """Names of the cameras of the library."""
    return tuple(sorted(path.stem for path in CAMERAS.glob("*.toml")))


def read_profile(name: str) -> CameraProfile:
    """Read a camera from the library by name, or from a TOML file with `[optics]` and `[body]` by path.

    Raises InputError for an unknown name and an invalid file.
    """
    if name in camera_names():
        return library()[name]
    return _profile(_path(name, ".toml"))


def named_camera(name: str) -> Camera:
    """Optics of a library camera by name; never reads any other file.

    Raises InputError for an unknown name and a camera without optics.
    """
    if name not in camera_names():
        names = ", ".join(camera_names())
        raise InputError(f"camera {shortened(name, 40)!r}: expected one of {names}, or a table of its figures")
    return library()[name].camera


def read_camera(name: str) -> Camera:
    """Optics of a library camera by name, or from a TOML or JSON file of a profile, a camera, or a calibrated camera.

    Raises InputError for an unknown name, an invalid file, and a camera without optics.
    """
    if name in camera_names():
        return named_camera(name)
    path = _path(name, ".toml", ".json")
    raw = read_bytes(path, LARGEST_TEXT_BYTES)
    tables = tables_of(path, raw)
    if isinstance(tables, dict) and tables.get("schema") == CALIBRATED_SCHEMA:
        return model_from(Camera, path, tables.get("camera"))
    return model_of(CameraProfile, path, raw).camera if _is_profile(path, raw) else model_of(Camera, path, raw)


def read_body(name: str) -> CameraBody:
    """Body of a library camera by name, or from a TOML file of a `CameraProfile` or a `CameraBody`.

    Raises InputError for an unknown name and an invalid file.
    """
    if name in camera_names():
        return library()[name].body
    path = _path(name, ".toml")
    raw = read_bytes(path, LARGEST_TEXT_BYTES)
    return model_of(CameraProfile, path, raw).body if _is_profile(path, raw) else model_of(CameraBody, path, raw)


def profile_of(camera: Camera) -> CameraProfile | None:
    """The library camera with the name of a layout's camera, which may be calibrated or binned."""
    for profile in library().values():
        if profile.optics and (camera.name == profile.name or camera.name.startswith(f"{profile.name}, scaled by ")):
            return profile
    return None


def _path(name: str, *suffixes: str) -> Path:
    if not name.lower().endswith(suffixes):
        names = ", ".join(camera_names())
        raise InputError(f"camera {shortened(name, 40)!r}: expected one of {names}, or a {' or '.join(suffixes)} file")
    return Path(name)


def _is_profile(path: Path, raw: bytes) -> bool:
    """Whether a file has separate tables for optics and body."""
    return not keys_of(path, raw).isdisjoint({"body", "optics"})
