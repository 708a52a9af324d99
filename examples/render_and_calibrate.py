"""Render a calibration set with a camera that is not built exactly as designed, and calibrate that camera from the set.

    python examples/render_and_calibrate.py [OUT]

Needs the extra `render`.
"""

import sys
from pathlib import Path

import mirrorcam


def main(out: Path) -> None:
    # A small webcam, so that this takes seconds.
    camera = mirrorcam.Camera(
        name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5
    )
    layout = mirrorcam.design(mirrorcam.DesignSpec(camera=camera, rows=2, cols=2))

    # Pictures of a ChArUco board: through slightly tilted and shifted mirrors, and by the camera alone.
    board = mirrorcam.Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)
    settings = mirrorcam.RenderSettings(renderer="fast", maps=False)
    request = mirrorcam.SetRequest(layout=layout, board=board, frames=6, base_frames=4, settings=settings)
    dataset = mirrorcam.render_set(request, out / "set")

    # Calibrate from the pictures, the nominal layout and the board; with a real camera, these are your own.
    frames = [out / "set" / name for name in dataset.frame_names]
    base_frames = [out / "set" / name for name in dataset.base_names]
    calibration = mirrorcam.calibrate(frames, base_frames, layout, board)
    calibration.layout.save(out / "calibrated.json")
    print(f"reprojection: {calibration.metrics['rms_x_px'].value:.4f} px RMS along x")

    # The truth of a rendered set is known: calibrate again without it, and compare.
    validation = mirrorcam.validate(out / "set")
    for name in ("normal_error_max_deg", "distance_error_max_mm"):
        print(f"{name}: {validation.metrics[name].value:.2g}, limit {validation.metrics[name].limit:g}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/calibrate"))
