"""`mirrorcam refocus`: pictures of a light field, focused, seen from elsewhere, without what stands in the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.commands.light_fields import LightFieldsOptions, distinct_names, opened
from mirrorcam.console.progress import count_text, long_work, say

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.light_field import LightField
    from mirrorcam.optics.light_field.render.refocusing import Picture
    from mirrorcam.optics.light_field.render.view_depths import ViewDepths

ORBIT_PICTURES, ORBIT_HZ = 36, 20.0
SWEEP_PICTURES, SWEEP_HZ = 24, 12.0
NEAR, FAR = 0.75, 2.0


class RefocusOptions(LightFieldsOptions):
    """Focus light fields after the shot: on any plane, on everything, from between the views, past what is near."""

    depth_mm: Annotated[
        tuple[Annotated[float, Field(allow_inf_nan=True)], ...],
        tyro.conf.arg(metavar="MM...", help_behavior_hint="(the reference plane's)"),
    ] = Field(default=(), description="depths from the pupil to focus on, a picture each; inf is one")
    tilt_deg: Annotated[tuple[float, float], tyro.conf.arg(metavar="RIGHT DOWN")] = Field(
        default=(0.0, 0.0), description="turn the plane about the middle: its right, its lower side moves away"
    )
    combine: Literal["mean", "median", "weighted"] = Field(
        default="mean",
        description="of the views: median leaves out what few show; weighted counts those far from the central less",
    )
    scale: int = Field(default=1, ge=1, le=8, description="super-sample: pixels of the picture along one of a view")
    all_in_focus: bool = Field(default=False, description="also a picture with everything sharp, by depth")
    from_mm: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="RIGHT DOWN", help_behavior_hint="")] = Field(
        default=None, description="also a sharp picture as seen from so far beside the central view"
    )
    behind_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None, gt=0, description="leave out of all pictures what lies nearer than this"
    )
    orbit: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(help_behavior_hint="")] = Field(
        default=None, description="also a loop around the views"
    )
    sweep: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(help_behavior_hint="")] = Field(
        default=None, description="also a loop of the focus from --near-mm to --far-mm and back"
    )
    near_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(what depth looks for)")] = Field(
        default=None, gt=0, description="nearest depth that is looked for, and swept from"
    )
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(what depth looks for)")] = Field(
        default=None, gt=0, allow_inf_nan=True, description="farthest depth that is looked for, and swept to"
    )
    out: Path = Field(
        default=Path("output/refocus"),
        description=(
            "folder for NAME_focus_MMmm.png and .npz (NumPy: image (h, w, c) 0 to 1, weights (h, w)), and alike "
            "NAME_all_in_focus, NAME_from; NAME_orbit.gif or .mp4, NAME_sweep"
        ),
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        for at, depth in enumerate(self.depth_mm):
            if not depth > 0:
                raise ValueError(f"focus at {depth:g} mm, expected a positive depth")
            if depth in self.depth_mm[:at]:
                raise ValueError(f"focus at {depth:g} mm twice, expected different depths")
        return self

    @property
    def needs_depths(self) -> bool:
        """Whether how deep things are must be measured."""
        return self.all_in_focus or self.from_mm is not None or self.behind_mm is not None or self.orbit is not None


def focused(light_field: LightField, options: RefocusOptions, depth_mm: float) -> Picture:
    """The picture in focus at a depth, as the options want it."""
    from mirrorcam.optics.light_field.render.refocusing import FocalPlane, aperture, refocus

    return refocus(
        light_field,
        FocalPlane.at_depth(light_field, depth_mm, options.tilt_deg),
        combine="median" if options.combine == "median" else "mean",
        view_weights=aperture(light_field) if options.combine == "weighted" else None,
        scale=options.scale,
    )


def stills(
    light_field: LightField, depths: ViewDepths | None, options: RefocusOptions
) -> Iterator[tuple[str, Picture]]:
    """The pictures that are asked for, each with what its name ends in."""
    import numpy as np

    from mirrorcam.optics.light_field.render.perspective import all_in_focus, seen_from

    others = options.all_in_focus or options.from_mm or options.orbit or options.sweep
    for depth_mm in options.depth_mm or (() if others else (light_field.reference_depth_mm,)):
        yield f"focus_{depth_mm:g}mm", focused(light_field, options, depth_mm)
    if depths is not None and options.all_in_focus:
        yield "all_in_focus", all_in_focus(light_field, depths)
    if depths is not None and options.from_mm is not None:
        yield "from", seen_from(light_field, depths, np.array([*options.from_mm, 0.0]))


def run(options: RefocusOptions) -> int:
    """Focus and write pictures."""
    import numpy as np

    from mirrorcam.optics.base.files import atomic, write_image
    from mirrorcam.optics.light_field.io.animation import write_loop
    from mirrorcam.optics.light_field.render.perspective import orbit, seen_from
    from mirrorcam.optics.light_field.render.refocusing import to_bytes
    from mirrorcam.optics.light_field.render.view_depths import ViewDepths, without_nearer

    names = distinct_names(options.light_fields, "pictures")
    unseen: list[str] = []
    with long_work("refocus", count_text(len(names), "light field"), "files") as advance:
        for done, path in enumerate(options.light_fields, start=1):
            for name, light_field, known in opened(path, options.layout):
                near, far = known or (None, None)
                near = near if options.near_mm is None else options.near_mm
                far = far if options.far_mm is None else options.far_mm
                depths = ViewDepths.measured(light_field, near_mm=near, far_mm=far) if options.needs_depths else None
                if depths is not None and options.behind_mm is not None:
                    light_field = without_nearer(light_field, depths, options.behind_mm)
                for title, picture in stills(light_field, depths, options):
                    with atomic(options.out / f"{name}_{title}.npz") as temporary:
                        np.savez_compressed(
                            temporary,
                            image=picture.image,
                            weights=picture.weights,
                            layout_identity=np.array(light_field.layout_identity),
                        )
                    write_image(options.out / f"{name}_{title}.png", to_bytes(picture))
                    hidden = 1.0 - picture.valid.mean()
                    if hidden > 0.01:
                        unseen.append(f"{name}_{title}: no view shows {hidden:.0%} of it (grey)")
                if depths is not None and options.orbit is not None:
                    places = list(orbit(light_field, ORBIT_PICTURES))
                    pictures = [to_bytes(seen_from(light_field, depths, place)) for place in places]
                    write_loop(options.out / f"{name}_orbit.{options.orbit}", pictures, ORBIT_HZ)
                if options.sweep is not None:
                    reference = light_field.reference_depth_mm
                    ends = 1.0 / (near or NEAR * reference), 1.0 / (far or FAR * reference)
                    sharp = [float(1.0 / q) if q > 0 else np.inf for q in np.linspace(*ends, SWEEP_PICTURES)]
                    pictures = [to_bytes(focused(light_field, options, depth_mm)) for depth_mm in sharp]
                    write_loop(options.out / f"{name}_sweep.{options.sweep}", pictures + pictures[-2:0:-1], SWEEP_HZ)
            advance(done, len(names))
    for line in unseen[:20]:
        say("refocus", line)
    say("refocus", f"pictures and arrays (.npz) written to {options.out}")
    return 0
