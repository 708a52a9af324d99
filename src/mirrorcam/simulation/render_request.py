"""Requests for rendered sets and scenes, from options and the files named in them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from cyclopts import Parameter
from pydantic import BeforeValidator, Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, PICTURES, SEED
from mirrorcam.core.command_text import command_text
from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue, Shaped, Value
from mirrorcam.optics.geometry.design_spec import MAX_DEPTHS
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import POSES_HZ, RATE_HZ, SENSORS, RendererName, RenderSettings, SensorModel

if TYPE_CHECKING:
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.render_scenes.sets.set_request import SetRequest
    from mirrorcam.render_scenes.tabletop.tabletop import UserMesh
    from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest


def tolerances_of(value: Any) -> Any:
    """Parse tolerances from text like tilt_deg=0.3,offset_mm=0.3; others keep defaults. "none" is a perfect device.

    Anything but text is returned unchanged.
    """
    if not isinstance(value, str):
        return value
    if value == "none":
        return Tolerances.none()
    parts = [part.partition("=") for part in value.split(",") if part]
    names = [name for name in Tolerances.model_fields if not name.startswith("distortion")]
    for name, _, _ in parts:
        if name not in names:
            raise ValueError(f"{name} is not a tolerance, expected {', '.join(names)}")
    try:
        with command_text():
            return Tolerances().replaced(**{name: value for name, _, value in parts})
    except InvalidValue as error:
        name = str(error.first["loc"][0]) if error.first else ""
        raise ValueError(f"{name}: {error.reason}") from None


def sensor_of(value: Any) -> Any:
    """Read a sensor model: a preset by its name, or a TOML file. Anything but text is returned unchanged."""
    if not isinstance(value, str):
        return value
    presets = {str(name): model for name, model in SENSORS.items()}
    if value in presets:
        return presets[value]
    if not value.endswith(".toml"):
        raise ValueError(f"expected {', '.join(presets)} or a .toml file")
    return read_model(SensorModel, Path(value))


AsBuilt = Annotated[
    Tolerances,
    BeforeValidator(tolerances_of),
    Parameter(metavar="NAME=VALUE,...", accepts_keys=False, show_default=False),
]
AS_BUILT = (
    "tolerances of the rendered device as in the table [tolerances] of design.toml, like tilt_deg=0.3,offset_mm=0.3; "
    "or none. [default: a hand-assembled device]"
)
Sensor = Annotated[
    SensorModel | None,
    BeforeValidator(sensor_of),
    Parameter(metavar="NAME|FILE", accepts_keys=False, show_default=False),
]
SENSOR = "lens and sensor: ideal, c920, poor, webcam, or a .toml file"


class PosesFile(Value):
    """Poses (n, 4, 4) of the board in the rig frame, mm, and the number of them that a motion passes per second."""

    poses: Annotated[FloatArray, Shaped((None, 4, 4), largest=DEPTH_MM.max)]
    poses_hz: float = POSES_HZ.field(1.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not 1 <= len(self.poses) <= PICTURES.max:
            raise ValueError(f"{len(self.poses)} poses, expected 1 to {PICTURES.max}")
        for number, pose in enumerate(self.poses):
            rotation = pose[:3, :3]
            if not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0.0, atol=1e-6) or np.linalg.det(rotation) < 0.0:
                raise ValueError(f"pose {number} has a matrix that is not a rotation")
            if tuple(pose[3]) != (0.0, 0.0, 0.0, 1.0):
                raise ValueError(f"pose {number} has the last row {pose[3].tolist()}, expected 0, 0, 0, 1")
        return self


@Parameter(name="*")
class RenderRequest(Value):
    """Options of `mirrorcam render`: pictures of a board."""

    frames: int = PICTURES.narrowed(min=1).field(20, "frames of the board via the mirrors")
    base_frames: int = PICTURES.field(10, "frames of the board with the camera alone, without mirrors")
    seed: int = SEED.field(0, "seed of poses, tolerances and noise; the same seed gives the same bytes")
    renderer: RendererName | None = Field(
        default=None,
        description="mitsuba: reference, by path tracing; fast: analytic, for large sets. [default: as in --settings, "
        "else mitsuba]",
    )
    sensor: Sensor = Field(default=None, description=f"{SENSOR}. [default: as in --settings, else c920]")
    as_built: AsBuilt = Field(default=Tolerances(), description=AS_BUILT)
    settings: Path | None = Field(
        default=None,
        description="TOML file of other settings: spp, finish of the mirrors, maps, video and more (docs/rendering.md)",
    )
    board: Path | None = Field(
        default=None, description="board.toml of the board to render. [default: the default board]"
    )
    poses: Path | None = Field(
        default=None, description="JSON file of poses, rig_from_board in mm. [default: planned poses]"
    )
    rate_hz: float | None = RATE_HZ.field(
        None, "frame rate of one smooth motion through the poses", unset="separate poses"
    )
    parts: Path | None = Field(
        default=None,
        description="folder that mirrorcam cad wrote for the layout: render its parts, which block and scatter light",
    )

    def read(self, layout: Layout) -> SetRequest:
        """Read the files of the request; raises InputError if one is invalid or contradicts others."""
        from mirrorcam.optics.geometry.boards import default_board, load_board
        from mirrorcam.render_scenes.sets.set_request import SetRequest

        settings = RenderSettings() if self.settings is None else read_model(RenderSettings, self.settings)
        chosen = {"renderer": self.renderer, "sensor": self.sensor}
        try:
            settings = settings.replaced(**{name: option for name, option in chosen.items() if option is not None})
        except InvalidValue as error:
            raise InputError(error.reason) from None
        if settings.video is not None and self.rate_hz is None:
            raise InputError(f"video {settings.video}: a video shows a motion, expected --rate-hz with it")
        poses_file = None if self.poses is None else read_model(PosesFile, self.poses, LARGEST_FILE_BYTES)
        return SetRequest(
            layout=layout,
            board=default_board() if self.board is None else load_board(self.board),
            frames=self.frames,
            base_frames=self.base_frames,
            seed=self.seed,
            tolerances=self.as_built,
            settings=settings,
            poses=() if poses_file is None else poses_file.poses.tolist(),
            poses_hz=1.0 if poses_file is None else poses_file.poses_hz,
            rate_hz=self.rate_hz,
            parts=self.parts,
        )


@Parameter(name="*")
class SceneRequest(Value):
    """Options of `mirrorcam scene`: a picture of a tabletop."""

    depths_mm: tuple[Annotated[float, DEPTH_MM.limits], ...] = Field(
        default=(),
        max_length=MAX_DEPTHS,
        description=f"depths of the objects, nearest first: {MAX_DEPTHS} at most, {DEPTH_MM}. [default: the layout's]",
    )
    mesh: Annotated[tuple[str, ...], Parameter(metavar="FILE[:x,y,z]...")] = Field(
        default=(),
        description="meshes to put on the table (STL, PLY or OBJ, in mm, z up), each with the centre of its base in "
        "view axes",
    )
    seed: int = SEED.field(0, "seed of objects, tolerances and noise; the same seed gives the same bytes")
    sensor: Sensor = Field(default=None, description=f"{SENSOR}. [default: c920]")
    as_built: AsBuilt = Field(default=Tolerances(), description=AS_BUILT)

    def read(self, layout: Layout) -> TabletopRequest:
        """Build the request for a scene; raises InputError for an invalid position of a mesh."""
        from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest

        return TabletopRequest(
            layout=layout,
            depths_mm=self.depths_mm,
            meshes=tuple(mesh_from_text(text) for text in self.mesh),
            seed=self.seed,
            tolerances=self.as_built,
            sensor=SENSORS["c920"] if self.sensor is None else self.sensor,
        )


def mesh_from_text(text: str) -> UserMesh:
    """Parse a mesh and its position from text like vase.stl:10,-30,350, or from a file name alone."""
    from mirrorcam.render_scenes.tabletop.tabletop import UserMesh

    name, colon, position = text.rpartition(":")
    numbers = position.split(",")
    if not colon or len(numbers) != 3:
        return UserMesh(file=Path(text))
    try:
        return UserMesh(file=Path(name), position_in_view_mm=[float(number) for number in numbers])
    except ValueError:
        raise InputError(f"--mesh {text}: expected FILE or FILE:x,y,z in mm, view axes") from None
