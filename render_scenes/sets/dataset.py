"""Manifest of a rendered set, `dataset.json`, without ground truth, and the set's true layout; no renderer needed."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.bounds import DEPTH_MM, PICTURES, SENSOR_PX
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model
from mirrorcam.core.disk.resumable import FolderManifest
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.lens import TrueLens
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.settings import RenderSettings

MANIFEST = "dataset.json"
USER_FILES = ("layout.json", "board.toml")
"""Files that the user of a real camera also has, besides the pictures."""
TRUTH = (
    *("truth/layout.json", "truth/poses.json", "truth/seed.json", "truth/corners.npz"),
    *("truth/readout.json", "truth/finish.json", "truth/lens.json"),
)
"""Files of the ground truth except its maps; the last three only if shutter, mirrors or lens are not ideal."""


class DepthRange(Value):
    """Range of depths of the boards visible in a mirror, and their maximum tilt to its view axis; 0 without boards."""

    nearest_mm: int = Field(ge=-DEPTH_MM.max, le=DEPTH_MM.max)
    farthest_mm: int = Field(ge=-DEPTH_MM.max, le=DEPTH_MM.max)
    tilt_deg: int = Field(ge=0, le=180)


class Dataset(FolderManifest):
    """Manifest of a rendered set: what the user of a real camera knows, and a checksum of each file written so far.

    `request` is a digest of everything that determines the bytes of the set, including the seed.
    """

    FILE = MANIFEST
    NOUN = "set"
    FILES = (*USER_FILES, "video.avi", "video.mp4")
    FOLDERS = ("frames", "base", "truth")
    DERIVED = frozenset({"coverage", "reaches", "base_coverage"})

    schema_id: Literal["mirrorcam.dataset/1"] = Field(default="mirrorcam.dataset/1", alias="schema")
    layout_identity: str
    board: CalibrationBoard = Field(alias="target")
    frames: int = PICTURES.field()
    base_frames: int = PICTURES.field()
    width_px: int = SENSOR_PX.field()
    height_px: int = SENSOR_PX.field()
    tolerances: Tolerances
    settings: RenderSettings
    rate_hz: float | None = Field(
        default=None, description="frames per second if they show one continuous motion; none: independent frames"
    )
    parts: str | None = Field(default=None, description="checksum of the parts around the mirrors, if any")
    renderer: str = Field(description="program, version and variant")
    coverage: tuple[float, ...] = Field(
        description="fraction of each sub-image in which the planned frames show corners"
    )
    reaches: tuple[DepthRange, ...] = Field(
        description="range of depths and tilts at which each mirror shows the planned boards"
    )
    base_coverage: float = Field(description="fraction of the full sensor in which the base frames show corners")
    request: str
    files: dict[str, str] = Field(
        default_factory=dict, repr=False, description="SHA-256 of each file, by its name in the set"
    )

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames via the mirrors, in order."""
        return tuple(f"frames/{index:04d}{self.settings.suffix}" for index in range(self.frames))

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the frames of the bare camera, in order."""
        return tuple(f"base/{index:04d}{self.settings.suffix}" for index in range(self.base_frames))

    @property
    def video_name(self) -> str | None:
        """Name of the video, if any."""
        return None if self.settings.video is None else f"video.{self.settings.video}"

    @property
    def planned_names(self) -> tuple[str, ...]:
        """Names of all files of the set when it is complete."""
        pictures = (*self.frame_names, *self.base_names)
        maps = (self.map_of(name) for name in pictures)
        optional = (*pictures, *maps, self.video_name, self.pupil_name)
        return (*USER_FILES, *TRUTH, *(name for name in optional if name is not None))

    @property
    def pupil_name(self) -> str | None:
        """Name of the ground truth of the pupil; None without maps or for a pinhole."""
        return "truth/pupil.exr" if self.settings.maps and self.settings.sensor.aperture_mm > 0.0 else None

    def map_of(self, name: str) -> str | None:
        """Name of the ground-truth maps of a picture, if any."""
        return f"truth/maps/{Path(name).with_suffix('.exr')}" if self.settings.maps else None

    @property
    def complete(self) -> bool:
        """True if every frame and the video have been written."""
        return not self.missing

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the pictures, and of the video, that have not been written."""
        required = (*self.frame_names, *self.base_names, self.video_name)
        return tuple(name for name in required if name is not None and name not in self.files)


TRUE_LAYOUT = "truth/layout.json"
FINISH = "truth/finish.json"
LENS = "truth/lens.json"


class _Finishes(Value):
    """Content of `truth/finish.json`."""

    mirrors: tuple[MirrorFinish, ...]


def true_lens(folder: Path) -> TrueLens | None:
    """Return what the layout of a set cannot describe of its lens; None for an ideal lens."""
    return read_model(TrueLens, folder / LENS) if (folder / LENS).is_file() else None


def true_layout(folder: Path) -> Layout:
    """Return the true layout of a set, with the bend of each mirror and the lens as grey pictures show them.

    A layout cannot describe ripples; their mean over a mirror is zero. Raises InputError for files that are invalid or
    do not match.
    """
    layout = Layout.load(folder / TRUE_LAYOUT)
    lens = true_lens(folder)
    if lens is not None:
        layout = layout.replaced(camera=lens.camera(layout.camera))
    if not (folder / FINISH).is_file():
        return layout
    finishes = read_model(_Finishes, folder / FINISH, LARGEST_LAYOUT_BYTES).mirrors
    if len(finishes) != len(layout.mirrors):
        raise InputError(f"{folder / FINISH}: {len(finishes)} finishes, expected {len(layout.mirrors)}, one per mirror")
    bent = tuple(finish.bent(mirror) for finish, mirror in zip(finishes, layout.mirrors, strict=True))
    return layout.replaced(mirrors=bent)
