"""`mirrorcam decode`: from frames to light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force, Layout
from mirrorcam.lightfield.requests import DecodeRequest


def decode(
    frames: Annotated[
        tuple[Path, ...],
        Parameter(
            name="FRAME|VIDEO...",
            help="frames of the camera (PNG, JPEG, TIFF or BMP), videos (such as MP4 or AVI), or ROS 2 bags of its "
            "pictures (BAG or BAG:/TOPIC)",
        ),
    ] = (),
    /,
    *,
    layout: Layout,
    request: DecodeRequest = DecodeRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/decoded"),
    force: Force = False,
) -> int:
    """Decode frames, videos or a camera into light fields.

    Writes, for each picture, NAME.npz (NumPy: samples (t, s, v, u, c), weights (t, s, v, u), positions_mm (t, s, 3) and
    the other fields of LightField) and NAME_views.png (all views), with --epi also NAME_epi.png and NAME_epi.npz (of
    the middle row of the central view). A video becomes NAME.zarr with NAME_views.png, a folder NAME, or NAME.mcap,
    depending on --to; for a camera, NAME is deviceNUMBER or stream. Recordings are never replaced; the same command
    resumes an interrupted one. Exit code 1: damaged frames were skipped.

    Examples:
        mirrorcam decode frame.png --layout calibrated/layout.json --epi
        mirrorcam decode recording.mp4 --layout calibrated/layout.json --to mcap --out bags
        mirrorcam decode --live 0 --layout calibrated/layout.json --view
    """
    from mirrorcam.calibration.drift_check import drift_check
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.decoding import decode_files

    lost = decode_files(frames, out, request, TERMINAL, layout=layout, force=force, make_check=drift_check)
    return 1 if lost else 0
