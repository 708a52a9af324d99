"""Measure the depth of one frame, and write it as a coloured point cloud.

    python examples/depth_to_ply.py [OUT]

Needs the extra `render` for the frame; with your own, read it and load the calibrated layout of your camera.
Open OUT/points.ply in MeshLab, CloudCompare or Blender.
"""

import sys
from pathlib import Path

import numpy as np

import mirrorcam


def main(out: Path) -> None:
    # A frame that shows a board through three mirrors.
    camera = mirrorcam.Camera(
        name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5
    )
    layout = mirrorcam.design(mirrorcam.DesignSpec(camera=camera, rows=1, cols=3))
    settings = mirrorcam.RenderSettings(renderer="fast", maps=False)
    request = mirrorcam.SetRequest(layout=layout, frames=1, base_frames=0, settings=settings)
    dataset = mirrorcam.render_set(request, out / "set")
    frame = mirrorcam.read_image(out / "set" / dataset.frame_names[0])

    # The rendered camera deviates from its design. A real one is calibrated; here, the truth is known.
    layout = mirrorcam.Layout.load(out / "set" / "truth" / "layout.json")
    light_field = mirrorcam.Decoder(layout).decode(frame)

    # Depth is measured from the camera's pupil along the views, in mm; confidence goes from 0 to 1.
    depth = mirrorcam.estimate_depth(light_field, near_mm=250.0, far_mm=800.0)
    reliable = depth.confidence > 0.5
    print(f"{reliable.mean():.0%} of the pixels reliable, median depth {np.median(depth.depth_mm[reliable]):.1f} mm")

    # Points are in mm in the frame of the camera: x right, y to the scene, z up.
    cloud = np.where(reliable, depth.depth_mm, np.float32(np.nan))
    mirrorcam.write_light_field(out / "points.ply", light_field, "ply", cloud)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/depth"))
