"""Recipes of rendered sets: short entries of a suite, and the requests that they expand to."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, PICTURES, SAMPLES_PER_PIXEL, SEED, Bounds
from mirrorcam.core.names import Line
from mirrorcam.core.values import FloatArray, InvalidValue, Shaped, Value, with_tuples
from mirrorcam.optics.geometry.boards import CalibrationBoard, default_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import MAX_DEPTHS, DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.sets.set_request import SetRequest, Stream
from mirrorcam.render_scenes.settings import (
    RATE_HZ,
    SENSORS,
    RendererName,
    RenderSettings,
    SensorModel,
    SurfaceFinish,
)

Slug = Annotated[str, Field(max_length=48, pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
"""A name of lower-case letters, digits and hyphens, also usable as a folder name."""
COPIES = PICTURES.narrowed(min=1)
BINNED = Bounds(0.05, 1.0)


def _sensor(data: object) -> object:
    """Read a suite's sensor: the name of a preset, or a table of changes to the preset named by `like`."""
    name = data.get("like") if isinstance(data, dict) else data
    if isinstance(name, str):
        presets = {str(preset): model for preset, model in SENSORS.items()}
        if name not in presets:
            raise ValueError(f"sensor {name[:40]!r}: expected one of {', '.join(presets)}")
        changes = {key: value for key, value in data.items() if key != "like"} if isinstance(data, dict) else {}
        return presets[name].model_dump() | changes
    return data


def _tolerances(data: object) -> object:
    return Tolerances.none().model_dump() if data == "none" else with_tuples(data)


class SetRecipe(Value):
    """The entry of a set in a suite; missing values have their defaults.

    Parameters
    ----------
    name
        Name of the set in its suite.
    why
        Purpose of the set.
    copies
        Number of sets that differ only in their seeds: `seed`, `seed` + 1, ...
    design
        Design of the device; `camera` is a name in the library, `pattern` a name such as hex7 or a table.
    layout
        A layout instead of a design.
    binned
        Number of pixels along an axis after binning, as a fraction of the camera's.
    lens_model, distortion
        The lens, instead of that of the camera in the library.
    tolerances
        Tolerances of the rendered device relative to its layout, or "none".
    sensor
        The name of a preset, a table of changes to the preset named by `like`, or a complete table.
    board, frames, base_frames, seed, rate_hz
        As in `SetRequest`.
    depths_mm
        Depths around which boards are placed, instead of the design's.
    renderer, spp, maps, finish
        As in `RenderSettings`.
    """

    name: Slug
    why: Line = ""
    copies: int = COPIES.field(1)
    design: Annotated[DesignSpec, BeforeValidator(with_tuples)] = Field(default_factory=DesignSpec)
    layout: Layout | None = None
    binned: float = BINNED.field(1.0)
    lens_model: LensName | None = None
    distortion: Annotated[FloatArray, Shaped((None,))] | None = None
    tolerances: Annotated[Tolerances, BeforeValidator(_tolerances)] = Tolerances()
    sensor: Annotated[SensorModel, BeforeValidator(_sensor)] = SENSORS["c920"]
    board: CalibrationBoard = Field(default_factory=default_board)
    depths_mm: tuple[Annotated[float, DEPTH_MM.limits], ...] = Field(default=(), max_length=MAX_DEPTHS)
    frames: int = PICTURES.narrowed(min=1).field(20)
    base_frames: int = PICTURES.field(10)
    seed: int = SEED.field(0)
    rate_hz: float | None = RATE_HZ.field(None)
    renderer: RendererName = "fast"
    spp: int = SAMPLES_PER_PIXEL.field(16)
    maps: bool = False
    finish: SurfaceFinish = SurfaceFinish()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.layout is not None and self.design != DesignSpec():
            raise ValueError("layout and design: expected at most one of the two")
        if (self.lens_model is None) != (self.distortion is None):
            raise ValueError("lens_model and distortion: expected both or none")
        if self.depths_mm and self.layout is not None and self.layout.spec is None:
            raise ValueError("depths_mm: the layout has no specification, expected one that `mirrorcam design` wrote")
        if self.seed + self.copies - 1 > SEED.max:
            raise ValueError(f"seed: the last copy's is {self.seed + self.copies - 1}, expected {SEED}")
        try:
            _ = self.settings, self.camera
        except InvalidValue as error:  # before any set is rendered
            raise ValueError(str(error)) from None
        return self

    @property
    def settings(self) -> RenderSettings:
        """Rendering settings."""
        return RenderSettings(
            renderer=self.renderer, spp=self.spp, sensor=self.sensor, finish=self.finish, maps=self.maps
        )

    @property
    def camera(self) -> Camera:
        """The camera of the layout or the design, with the recipe's lens and binning."""
        camera = self.design.camera if self.layout is None else self.layout.camera
        if self.lens_model is not None:
            camera = camera.replaced(lens_model=self.lens_model, lens_grid=None, distortion=self.distortion)
        return camera if self.binned == 1.0 else camera.binned(self.binned)

    @property
    def spec(self) -> DesignSpec | None:
        """The design to solve; None if a layout is given."""
        return self.design.replaced(camera=self.camera) if self.layout is None else None

    @property
    def mirrors(self) -> int:
        """Number of mirrors."""
        return len(self.design.arrangement.steps) if self.layout is None else len(self.layout.mirrors)

    @property
    def pictures(self) -> int:
        """Number of pictures."""
        return self.frames + self.base_frames

    def expanded(self) -> tuple[Self, ...]:
        """One recipe per copy, with the copy's number at the end of its name."""
        if self.copies == 1:
            return (self,)
        return tuple(
            self.replaced(name=f"{self.name}-{number:04d}", seed=self.seed + number, copies=1)
            for number in range(self.copies)
        )

    def content_inputs(self) -> dict[str, Any]:
        """Return all inputs that determine the set's bytes, as JSON, with the camera's numbers instead of its name."""
        content_inputs = self.model_dump(mode="json", by_alias=True, exclude={"name", "why", "copies"})
        return content_inputs | {"camera": self.camera.model_dump(mode="json")}

    def request(self, designed: Layout | None) -> SetRequest:
        """Return the request for the set, with the layout solved from `spec`.

        Raises InputError if the board is not visible at the given depths.
        """
        layout = designed if self.layout is None else self.layout.replaced(camera=self.camera)
        assert layout is not None, "a recipe without a layout needs the one of its design"
        request = SetRequest(
            layout=layout,
            board=self.board,
            frames=self.frames,
            base_frames=self.base_frames,
            seed=self.seed,
            tolerances=self.tolerances,
            settings=self.settings,
            rate_hz=self.rate_hz,
        )
        if not self.depths_mm or layout.spec is None:
            return request
        layout_at_depths = layout.replaced(spec=layout.spec.replaced(depths_mm=self.depths_mm))
        plan = plan_frames(layout_at_depths, self.board, self.frames, request.random(Stream.POSES))
        return request.replaced(poses=plan.poses.tolist())
