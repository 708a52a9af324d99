"""`mirrorcam render`: a synthetic calibration set with sealed truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.extras import require
from mirrorcam.progress import count_text, long_work, say
from optics.values import Value


class RenderOptions(Value):
    """Render what a layout, built with tolerances, photographs: frames of a board, and the truth in its own folder."""

    layout: tyro.conf.Positional[Path] = Field(description="layout.json, as designed")
    frames: int = Field(default=20, ge=1, description="frames of the board through the mirrors")
    base_frames: int = Field(default=10, ge=1, description="frames of the board by the bare camera, without mirrors")
    seed: int = Field(default=0, ge=0, description="seed of poses, tolerances and noise; the same seed, the same bytes")
    tilt_deg: float = Field(default=0.3, ge=0, description="tilt of a mirror from its design (sigma, about two axes)")
    offset_mm: float = Field(default=0.3, ge=0, description="shift of a mirror along its normal (sigma)")
    spp: int = Field(default=16, ge=1, description="samples per pixel")
    board: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="board.toml; without it, the default board"
    )
    out: Path = Field(default=Path("output/set"), description="folder for the set; an interrupted one is continued")


def run(options: RenderOptions) -> int:
    """Render the set."""
    from optics.layout import Layout
    from optics.targets import default_board, load_board
    from optics.tolerances import Tolerances

    layout = Layout.load(options.layout)
    target = default_board() if options.board is None else load_board(options.board)
    require("render")
    from render_scenes.render_set import render_set

    with long_work("render", f"{options.frames} + {count_text(options.base_frames, 'frame')}", "frames") as advance:
        render_set(
            layout,
            target,
            options.out,
            frames=options.frames,
            base_frames=options.base_frames,
            seed=options.seed,
            tolerances=Tolerances(tilt_deg=options.tilt_deg, offset_mm=options.offset_mm),
            spp=options.spp,
            on_frame=advance,
        )
    say("render", f"{options.out / 'dataset.json'} written; what is in {options.out / 'truth'} is for validate alone")
    return 0
