"""`mirrorcam depth`: how deep everything in a light field is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.progress import count_text, long_work, say
from optics.values import InputError, Value

if TYPE_CHECKING:
    from optics.light_field.light_field import LightField

PICTURES = (".png", ".jpg", ".jpeg")


class DepthOptions(Value):
    """Measure depth in light fields: a picture with a scale in mm, and arrays."""

    light_fields: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LIGHTFIELD...", help_behavior_hint="")
    ] = Field(
        min_length=1,
        description=(
            "what mirrorcam decode wrote (.npz or .zarr), a folder of the 4D Light Field Benchmark, or, with --layout, "
            "PNG or JPEG frames of the camera"
        ),
    )
    layout: Path | None = Field(default=None, description="layout.json of frames, calibrated where there is one")
    near_mm: Annotated[
        float | None, tyro.conf.arg(help_behavior_hint="(0.6 reference depths, or what a scene states)")
    ] = Field(default=None, description="nearest depth that is looked for, from the pupil")
    far_mm: Annotated[
        float | None, tyro.conf.arg(help_behavior_hint="(2 reference depths, or what a scene states)")
    ] = Field(default=None, description="farthest depth that is looked for")
    out: Path = Field(
        default=Path("output/depth"),
        description=(
            "folder for NAME_depth.png (view, depth, confidence), NAME_depth.npz (NumPy: depth_mm, sigma_mm and "
            "confidence (v, u) of the central view) and NAME_depth.pfm (mm) of each light field"
        ),
    )


def opened(path: Path, layout: Path | None) -> Iterator[tuple[str, LightField, tuple[float, float] | None]]:
    """The light fields of a file or folder, one after the other, each with a name and the depths it says it has."""
    from optics.files import read_image
    from optics.light_field.files import load_npz
    from optics.light_field.formats.hci import PARAMETERS, read_hci

    if path.suffix.lower() in PICTURES:
        if layout is None:
            raise InputError(f"{path}: a frame, expected --layout to decode it with, or a light field")
        from optics.layout import Layout
        from optics.light_field.decode import Decoder

        yield path.stem, Decoder(Layout.load(layout)).decode(read_image(path)), None
    elif (path / PARAMETERS).exists():
        scene = read_hci(path)
        yield path.name, scene.light_field, scene.depth_range_mm
    elif path.is_dir():
        from optics.light_field.zarr_store import StoredLightFields

        stored = StoredLightFields(path)
        for frame in range(len(stored)):
            yield f"{path.stem}_{frame:06d}", stored[frame], None
    else:
        yield path.stem, load_npz(path), None


def run(options: DepthOptions) -> int:
    """Measure and write depths."""
    import numpy as np

    from mirrorcam.figures.depth import draw_depth
    from optics.files import atomic
    from optics.light_field.depth import DepthEstimator
    from optics.light_field.formats.pfm import write_pfm

    names = [path.stem for path in options.light_fields]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two light fields are called {twice!r}, expected different names: each names its depth map")
    estimator: DepthEstimator | None = None
    summary: list[str] = []
    with long_work("depth", count_text(len(names), "light field"), "files") as advance:
        for done, path in enumerate(options.light_fields, start=1):
            for name, light_field, known in opened(path, options.layout):
                if estimator is None or not estimator.fits(light_field):
                    near, far = known or (None, None)
                    near = near if options.near_mm is None else options.near_mm
                    far = far if options.far_mm is None else options.far_mm
                    estimator = DepthEstimator(light_field, near_mm=near, far_mm=far)
                depth = estimator.estimate(light_field)
                with atomic(options.out / f"{name}_depth.npz") as temporary:
                    np.savez_compressed(
                        temporary,
                        depth_mm=depth.depth_mm,
                        sigma_mm=depth.sigma_mm,
                        confidence=depth.confidence,
                        view=np.array(depth.view),
                        layout_identity=np.array(depth.views.layout_identity),
                    )
                write_pfm(options.out / f"{name}_depth.pfm", depth.depth_mm)
                draw_depth(options.out / f"{name}_depth.png", light_field, depth)
                sure = depth.valid & (depth.confidence > 0.5)
                middle = f"median {np.median(depth.depth_mm[sure]):.0f} mm" if sure.any() else "nothing sure"
                summary.append(f"{name}: {sure.mean():.0%} of the pixels with confidence above 0.5, {middle}")
            advance(done, len(names))
    for line in summary[:20]:
        say("depth", line)
    say("depth", f"pictures, arrays (.npz) and maps (.pfm) written to {options.out}")
    return 0
