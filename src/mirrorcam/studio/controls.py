"""The controls of a design's request: fields, ranges, and the effect of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Literal

from pydantic import Field

from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import library
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror_stock import STOCKS, stock_fields
from mirrorcam.optics.geometry.rectangle_sizes import SOLD_SIZES

DEGREE = "\N{DEGREE SIGN}"
UNBOUNDED = (None, None)


class Named(Value):
    """Fields of a request to choose by a name; `key` is the name of a value in addresses, empty without one."""

    key: str = ""
    text: str
    fields: dict[str, Any]


class CameraNumber(Value):
    """A number of a camera, its range, and its default."""

    name: str
    label: str
    unit: str
    allowed: tuple[float | None, float | None]
    preset: float | None


class Control(Value):
    """One control: the field of the request that it sets, and the range of its slider.

    A number may be entered beyond the ends of the slider, within the range `allowed` (None: unbounded).

    A choice of `named` values sets their fields; `numbers` are those of a camera, to change one by one. A slider with
    `values` snaps to them. `auto` is the text of a switch that leaves the value to the optimiser, and
    `preset` the value when it is switched off.
    """

    name: str
    label: str
    help: str
    kind: Literal["slider", "counts", "depths", "choice", "named", "shape"] = "slider"
    unit: str = ""
    least: float = 0.0
    most: float = 1.0
    step: float = 1.0
    log: bool = False
    allowed: tuple[float | None, float | None] = UNBOUNDED
    values: tuple[float, ...] = ()
    choices: tuple[tuple[str, str], ...] = ()
    preset: float | bool | str | None = None
    auto: str = ""
    named: tuple[Named, ...] = ()
    numbers: tuple[CameraNumber, ...] = ()


class ControlGroup(Value):
    """Controls under one title."""

    title: str
    open: bool = True
    controls: tuple[Control, ...] = Field(min_length=1)


CAMERA_NUMBERS = (
    ("width_px", "Width", "px"),
    ("height_px", "Height", "px"),
    ("fx_px", "Focal length, x", "px"),
    ("fy_px", "Focal length, y", "px"),
    ("cx_px", "Principal point, x", "px"),
    ("cy_px", "Principal point, y", "px"),
    ("aperture_mm", "Aperture", "mm"),
    ("focus_mm", "In focus at", "mm"),
)


def control_groups(spec: DesignSpec) -> tuple[ControlGroup, ...]:
    """Return all controls; the request's camera is offered even if it is not in the library."""
    cameras = _with_own(_library_cameras(), spec, "camera", spec.camera.name)
    camera = Control(
        name="camera",
        label="Camera",
        kind="named",
        help="The webcam below the mirrors. Its pixels are what all views share; its lens and body decide how near "
        "mirrors can be.",
        named=cameras,
        numbers=tuple(
            CameraNumber(
                name=name, label=label, unit=unit, allowed=_allowed(Camera, name), preset=_preset(Camera, name)
            )
            for name, label, unit in CAMERA_NUMBERS
        ),
    )
    pattern = _PATTERN
    if spec.pattern is not None:
        pattern = pattern.replaced(named=_with_own(pattern.named, spec, "pattern", spec.pattern.name))
    return (
        ControlGroup(title="Camera and views", controls=(camera, pattern, *map(_bounded, _VIEWS))),
        ControlGroup(title="Scene", controls=tuple(map(_bounded, _SCENE))),
        ControlGroup(title="Mirrors", controls=tuple(map(_bounded, _MIRRORS))),
        ControlGroup(title="Limits and tolerances", open=False, controls=tuple(map(_bounded, _LIMITS))),
    )


@cache
def _library_cameras() -> tuple[Named, ...]:
    """Cameras of the library with their optics, the default one first."""
    found = [(key, profile.camera) for key, profile in library().items() if profile.optics]
    return tuple(
        Named(key=key, text=camera.name, fields={"camera": camera.model_dump(mode="json")})
        for key, camera in sorted(found, key=lambda pair: pair[1] != Camera.c920())
    )


def _with_own(named: tuple[Named, ...], spec: DesignSpec, name: str, text: str) -> tuple[Named, ...]:
    """Return named values with the request's own, if it is none of them."""
    own = {name: getattr(spec, name).model_dump(mode="json")}
    return named if any(each.fields == own for each in named) else (*named, Named(text=text, fields=own))


def _bounded(control: Control) -> Control:
    """Return a control with the limits of its field, unless it has its own."""
    return control if control.allowed != UNBOUNDED else control.replaced(allowed=_allowed(DesignSpec, control.name))


def _preset(model: type[Value], name: str) -> float | None:
    field = model.model_fields[name]
    return None if field.is_required() else float(field.default)


@cache
def _allowed(model: type[Value], name: str) -> tuple[float | None, float | None]:
    """Return the minimum and maximum that a field, or each of its elements, accepts."""
    field = model.model_json_schema()["properties"][name]
    parts = (field, field.get("items", {}), *field.get("anyOf", ()))
    bounded: dict[str, float] = next((part for part in parts if "minimum" in part), {})
    return bounded.get("minimum"), bounded.get("maximum")


def change_text(spec: DesignSpec, other: DesignSpec, parameter: str) -> str:
    """Describe how two requests differ in a parameter: "Scale 92 mm instead of 50 mm"."""
    if parameter in ("rows", "cols"):
        return f"{other.rows} x {other.cols} mirrors instead of {spec.rows} x {spec.cols}"
    control = next(item for group in control_groups(spec) for item in group.controls if item.name == parameter)
    texts = [_value_text(getattr(request, parameter), control.unit) for request in (other, spec)]
    return f"{control.label} {texts[0]} instead of {texts[1]}"


def _value_text(value: float | tuple[float, ...] | str, unit: str) -> str:
    numbers = value if isinstance(value, tuple) else (value,)
    text = ", ".join(number if isinstance(number, str) else f"{number:.4g}" for number in numbers)
    return f"{text}{'' if unit in ('', DEGREE) else ' '}{unit}"


def snapping_groups(axes: Mapping[str, Sequence[float]]) -> tuple[ControlGroup, ...]:
    """Return only the controls of the fields in `axes`, which snap to the values in `axes`."""
    by_name = {control.name: control for control in (*_VIEWS, *_SCENE)}
    counts = by_name["rows"]
    controls = [
        *(
            Control(name=name, label=label, values=tuple(axes[name]), help=counts.help if name == "cols" else "")
            for name, label in (("rows", "Rows"), ("cols", "Columns"))
        ),
        *(by_name[name].replaced(values=tuple(axes[name])) for name in ("scale_mm", "tradeoff")),
    ]
    return (ControlGroup(title="Solved designs", controls=tuple(controls)),)


_PATTERN = Control(
    name="pattern",
    label="Arrangement",
    kind="named",
    help="A grid suits most algorithms; hexagons pack views densely; a ring has long baselines in all directions.",
    named=(
        Named(text="rows and columns", fields={"pattern": None}),
        *(
            Named(key=pattern.name, text=text, fields={"pattern": pattern.model_dump(mode="json")})
            for text, pattern in (
                ("hexagon of 7", Pattern.hexagonal(1)),
                ("hexagon of 19", Pattern.hexagonal(2)),
                ("ring of 6", Pattern.ring(6)),
                ("ring of 8", Pattern.ring(8)),
            )
        ),
    ),
)
_VIEWS = (
    Control(
        name="rows",
        label="Rows and columns",
        kind="counts",
        least=1,
        most=6,
        help="More views see around more obstacles and average more noise; each gets fewer pixels.",
    ),
    Control(
        name="scale_mm",
        label="Scale",
        unit="mm",
        least=30,
        most=200,
        log=True,
        allowed=(10.0, 1000.0),
        help="Distance of the central mirror from the lens. A larger device has longer baselines, so finer depth; it "
        "is heavier, and its views overlap only farther away.",
    ),
    Control(
        name="fold_deg",
        label="Fold",
        unit=DEGREE,
        least=60,
        most=150,
        preset=120.0,
        auto="choose the best",
        help="Angle between the camera's axis and the views. Larger folds keep the camera out of the light; smaller "
        "ones need smaller mirrors.",
    ),
)
_SCENE = (
    Control(
        name="depths_mm",
        label="Working depths",
        kind="depths",
        unit="mm",
        least=80,
        most=3000,
        step=5,
        log=True,
        help="Depths, from the lens, where all views should see the same. Depths close together share more pixels.",
    ),
    Control(
        name="tradeoff",
        label="Trade-off",
        least=0,
        most=1,
        step=0.01,
        help="At 0, shared pixels alone count; at 1, a regular grid of views alone, which many algorithms expect.",
    ),
    Control(
        name="objective",
        label="Objective",
        kind="choice",
        choices=(("overlap", "overlap"), ("depth", "depth")),
        preset="overlap",
        help="Depth gives up 1 % of the overlap for the smallest standard deviation of depth.",
    ),
)
_MIRRORS = (
    Control(
        name="spacing_mm",
        label="Spacing",
        unit="mm",
        least=0,
        most=10,
        step=0.1,
        help="Gap between any two mirrors, for the walls of the holder: wide gaps print easily and cost pixels.",
    ),
    Control(
        name="sides",
        label="Corners of a mirror",
        kind="choice",
        choices=(("4", "4"), ("5", "5"), ("6", "6")),
        preset=4,
        help="Of free outlines: more corners fit the shared field better, for a few per cent more pixels.",
    ),
    Control(
        name="shape",
        label="Shape of a mirror",
        kind="shape",
        choices=(("rectangles", "rectangles"), ("stock:", "sizes in stock"), ("free", "free")),
        preset=SOLD_SIZES,
        help="Free outlines use the most pixels; rectangles are cut with a glass cutter or a guillotine; sizes in "
        "stock are bought cut: width x height in mm, such as 25x15, 30x20.",
    ),
    Control(
        name="size_step_mm",
        label="Step of the sides",
        unit="mm",
        least=0.5,
        most=10,
        step=0.5,
        help="Of rectangles that are cut: each side is a multiple of it.",
    ),
    Control(
        name="same_size",
        label="Sizes of the rectangles",
        kind="choice",
        choices=(("false", "any"), ("true", "all the same")),
        preset=False,
        help="Rectangles of one size are cut with one stop, and none can be mistaken for another.",
    ),
    Control(
        name="surface",
        label="Mirrors",
        kind="named",
        help="First-surface mirrors have no ghosts; second-surface ones are cheap and robust. Thickness and index can "
        "be changed below.",
        named=tuple(
            Named(text=name.replace("-", ", ", 1).replace("-", " ") + " mm", fields=dict(stock_fields(name)))
            for name in STOCKS
        ),
    ),
    Control(
        name="thickness_mm",
        label="Thickness",
        unit="mm",
        least=0.5,
        most=5,
        step=0.1,
        help="Of the mirrors. Thick ones stay flat, but their edges stand in the light.",
    ),
    Control(
        name="refractive_index",
        label="Refractive index",
        least=1.3,
        most=1.9,
        step=0.01,
        help="Acrylic 1.49, float glass 1.52: light passes through second-surface mirrors.",
    ),
)
_LIMITS = (
    Control(
        name="seen_gap_mm",
        label="Gap between sub-images",
        unit="mm",
        least=0,
        most=5,
        step=0.1,
        help="Seen from the lens, at the distance of the central mirror: room for mirrors out of position.",
    ),
    Control(
        name="body_clearance_mm",
        label="Space around the camera",
        unit="mm",
        least=0,
        most=30,
        step=0.5,
        help="For its clip: mirrors and their light stay out of it.",
    ),
    Control(
        name="min_edge_mm",
        label="Shortest edge",
        unit="mm",
        least=1,
        most=15,
        step=0.5,
        help="Of a mirror that you can cut.",
    ),
    Control(
        name="min_area_mm2",
        label="Smallest area",
        unit="mm\N{SUPERSCRIPT TWO}",
        least=5,
        most=400,
        step=5,
        help="Of a mirror that you can cut and glue.",
    ),
    Control(
        name="robust_tilt_deg",
        label="Tilt to allow for",
        unit=DEGREE,
        least=0,
        most=1,
        step=0.05,
        help="Standard deviation of mirrors' tilts: the mean over as-built devices is then optimised, which takes "
        "longer.",
    ),
    Control(
        name="robust_offset_mm",
        label="Shift to allow for",
        unit="mm",
        least=0,
        most=1,
        step=0.05,
        help="Standard deviation of mirrors' shifts along their normals, so that none hides part of another.",
    ),
)
