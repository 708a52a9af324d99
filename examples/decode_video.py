"""Decode a video of a mirror camera into light fields, frame by frame.

    python examples/decode_video.py [OUT [VIDEO LAYOUT]]

Decodes VIDEO with LAYOUT, the `layout.json` that `mirrorcam calibrate` wrote for your camera. By default, it
first renders a short video (this needs the extra `render`) and decodes it with the nominal layout. The rendered camera
deviates from its design, as every real one does, so that the views are shifted by a few pixels relative to each other:
depth and refocusing need the calibrated layout.
"""

import sys
from pathlib import Path

import mirrorcam
from mirrorcam.lightfield.decoding import decode_files


def rendered_video(out: Path) -> tuple[Path, Path]:
    """A short video of a moving board, and the nominal layout of the camera that took it."""
    camera = mirrorcam.Camera(
        name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5
    )
    layout = mirrorcam.design(mirrorcam.DesignSpec(camera=camera, rows=1, cols=2))
    settings = mirrorcam.RenderSettings(renderer="fast", maps=False, video="mp4")
    request = mirrorcam.SetRequest(layout=layout, frames=4, base_frames=0, rate_hz=10.0, settings=settings)
    mirrorcam.render_set(request, out)
    return out / "video.mp4", out / "layout.json"


def main(out: Path, *files: Path) -> None:
    video, layout = files or rendered_video(out / "set")

    # Every frame becomes a light field in one Zarr group; an interrupted run is resumed.
    decode_files((video,), out, layout=layout)

    # The first four frames. Samples are [t, s, v, u, c]: rows and columns of views, rows and columns of pixels, colour.
    for number in range(4):
        light_field = mirrorcam.open_light_field(out / f"{video.stem}.zarr", frame=number)
        print(f"frame {number}: samples {light_field.samples.shape}, {light_field.valid.mean():.0%} valid")
    print(f"the views are {light_field.step_mm('s'):.1f} mm apart")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:] or ["output/examples/video"]))
