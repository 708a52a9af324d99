"""`mirrorcam decode`: from frames to light fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.progress import Advance, count_text, long_work, say
from optics.values import InputError, Value


class DecodeOptions(Value):
    """Decode frames into light fields, with a picture of all views."""

    frames: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FRAME...", help_behavior_hint="")
    ] = Field(min_length=1, description="PNG or JPEG frames of the camera")
    layout: Path = Field(description="layout.json, calibrated where there is one")
    out: Path = Field(
        default=Path("output/decoded"),
        description=(
            "folder for NAME.npz (NumPy: samples (t, s, v, u, c), weights (t, s, v, u), positions_mm (t, s, 3) and the "
            "other fields of LightField) and NAME_views.png of each frame"
        ),
    )


def decode_frames(frames: Sequence[Path], layout_path: Path, out: Path, advance: Advance) -> None:
    """Decode frames into `out`; every frame is read once before anything is written, so that a bad one stops it all.

    Raises InputError for a frame that cannot be read or is not of the layout's camera, and for two of the same name.
    """
    from optics.files import read_image, write_image
    from optics.layout import Layout
    from optics.light_field.decode import Decoder
    from optics.light_field.files import save_npz
    from optics.light_field.tiles import tiles

    layout = Layout.load(layout_path)
    names = [frame.stem for frame in frames]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two frames are called {twice!r}, expected different names: each names its light field")
    size = layout.camera.width_px, layout.camera.height_px
    for frame in frames:
        height, width = read_image(frame).shape[:2]
        if (width, height) != size:
            raise InputError(f"{frame}: {width}x{height} px, expected {size[0]}x{size[1]} of {layout_path}'s camera")
    decoder = Decoder(layout)
    for done, frame in enumerate(frames, start=1):
        light_field = decoder.decode(read_image(frame))
        save_npz(out / f"{frame.stem}.npz", light_field)
        write_image(out / f"{frame.stem}_views.png", tiles(light_field))
        advance(done, len(frames))


def run(options: DecodeOptions) -> int:
    """Decode the frames."""
    with long_work("decode", count_text(len(options.frames), "frame"), "frames") as advance:
        decode_frames(options.frames, options.layout, options.out, advance)
    say("decode", f"light fields (.npz) and tiled views (_views.png) written to {options.out}")
    return 0
