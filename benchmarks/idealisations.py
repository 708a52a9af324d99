"""What a real setup has and the simulation has not, and how much each matters: `python -m benchmarks.idealisations`.

Prints the table of docs/idealisations.md; it takes a quarter of an hour. Each row is one effect alone, of an assumed
size, at the default device of seed 0:

- corners: how far it moves them, RMS per axis;
- normals, held-out: by how much it changes the worst normal and the error of held-out corners (in quadrature), between
  two calibrations from the same corners with and without it. Effects of geometry: 20 + 10 frames, corners by projection
  with noise of 0.01 px, the same in both. Effects in pictures: 12 + 6 frames, corners found in pictures without noise;
- views: PSNR of the decoded views of a tabletop scene with the effect against those without it. Of effects of
  geometry, by the slopes of the views and the error of held-out corners.

What changes after the calibration is not calibrated again: held-out corners are off by all of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks import idealised_corners as geometry
from benchmarks.idealised_corners import Effect, Setup
from benchmarks.idealised_pictures import PLAIN, Flaw, Table, effects, frame_s, ghosted, psnr_db, shaded, without_tone
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.render_scenes.settings import SENSORS, SensorModel

CLAIMED = Effect(corners_px=0.05, normals_deg=0.001, held_out_px=0.02)
CLAIMED_DB = 41.0
PART = 0.1
"""Part of a claimed figure from which on an effect counts."""
ROUNDED_DEG = 1.5e-4
"""What the rounding of pictures to 8 bits alone changes normals by; less does not count."""
SPP = 64
WEBCAM, C920, POOR = SENSORS["webcam"], SENSORS["c920"], SENSORS["poor"]


@dataclass(frozen=True)
class Row:
    """An effect: its assumed size with the source, and whether it is in the renderers."""

    effect: str
    assumed: str
    built: str


@dataclass(frozen=True)
class Geometry:
    """An effect on where corners are seen; by `since_deg` it has turned the mirrors since the calibration."""

    row: Row
    seen: Callable[[Setup], Observations]
    since_deg: float | None = None


GEOMETRY = (
    Geometry(
        Row("lens beyond five parameters", "0.05 px RMS, waves of half the width [1]", "webcam"),
        lambda setup: geometry.other_lens(setup, WEBCAM.lens_waves_px),
    ),
    Geometry(
        Row("pupil that walks with the angle", "0.1 mm at 45°, 3 % of the focal length; no data", "webcam"),
        lambda setup: geometry.walking_pupil(setup, WEBCAM.pupil_walk_mm),
    ),
    Geometry(
        Row("mirrors bent", "sag 2.5 µm (4 to 6 λ an inch, commercial mirrors)", "`finish`"),
        lambda setup: geometry.bent_mirrors(setup, 0.0025),
    ),
    Geometry(
        Row("paper bent", "sag 0.3 mm along a diagonal", "no: [2]"), lambda setup: geometry.bowed_board(setup, 0.3)
    ),
    Geometry(
        Row("paper stretched, print uneven", "0.05 % along one axis, 0.02 mm a corner", "no: [2]"),
        lambda setup: geometry.printed_board(setup, 5e-4, 0.02),
    ),
    Geometry(
        Row("autofocus between frames", "0.02 dioptres RMS; grows by 3.67 mm of it", "no: [3]"),
        lambda setup: geometry.breathing(setup, 0.02),
    ),
    Geometry(
        Row("hand-held board, rolling shutter", "2 mm/s, readout 30 ms", "`--rate-hz`"),
        lambda setup: geometry.moving_board(setup, 2.0),
    ),
    Geometry(
        Row("holder warmer than when calibrated", "10 K of PLA, 68 ppm/K", "no: [4]"),
        lambda setup: geometry.warmer(setup, 6.8e-4),
        since_deg=0.0,
    ),
    Geometry(
        Row("camera turned in its clip since", "0.01°", "no: [4]"),
        lambda setup: geometry.turned_camera(setup, 0.01),
        since_deg=0.01,
    ),
)

PICTURES = (
    (
        Row("Bayer mosaic, demosaiced", "RGGB, OpenCV's edge-aware method", "webcam"),
        Flaw(PLAIN.replaced(bayer=True)),
    ),
    (
        Row("lateral chromatic aberration", "±0.04 % (Imatest: the least that is not insignificant)", "webcam"),
        Flaw(PLAIN.replaced(lateral_chromatic_percent=WEBCAM.lateral_chromatic_percent)),
    ),
    (
        Row("axial chromatic aberration", "0.5 px: 11 µm of focus at f/2", "webcam"),
        Flaw(PLAIN.replaced(axial_chromatic_px=WEBCAM.axial_chromatic_px)),
    ),
    (
        Row("tone curve", "sRGB (IEC 61966-2-1); views made linear [7]", "webcam"),
        Flaw(PLAIN.replaced(tone_curve="srgb"), as_linear=without_tone),
    ),
    (
        Row("sharpening", "unsharp masking, 0.5 of sigma 1 px", "webcam"),
        Flaw(PLAIN.replaced(sharpening=WEBCAM.sharpening)),
    ),
    (
        Row("noise", "8000 electrons, 0.8 grey levels", "c920, poor"),
        Flaw(PLAIN.replaced(full_well_electrons=8000.0, read_noise_grey=0.8)),
    ),
    (
        Row("noise, then noise reduction", "the same, bilateral filter of 3 grey levels", "webcam"),
        Flaw(
            PLAIN.replaced(full_well_electrons=8000.0, read_noise_grey=0.8, denoising_grey=WEBCAM.denoising_grey),
        ),
    ),
    (
        Row("unlike pixels", "0.5 % (EMVA 1288 sheets of CMOS sensors: 0.3 to 1 %)", "webcam, poor"),
        Flaw(PLAIN.replaced(prnu_percent=WEBCAM.prnu_percent)),
    ),
    (
        Row("veiling glare", "1 % of the mean light", "webcam, poor"),
        Flaw(PLAIN.replaced(veiling_glare=WEBCAM.veiling_glare)),
    ),
    (Row("ghost of the lens", "0.1 %, turned by 180°", "no: [5]"), Flaw(PLAIN, ghosted)),
    (Row("vignetting", "cos² (c920); cos⁴ is natural", "c920, poor"), Flaw(PLAIN.replaced(vignetting=C920.vignetting))),
    (
        Row("uneven light on the board", "±15 % across the picture", "no: the views show it as it is"),
        Flaw(PLAIN, shaded),
    ),
    (Row("JPEG, c920", "quality 95", "c920"), Flaw(PLAIN.replaced(jpeg_quality=C920.jpeg_quality))),
    (Row("MJPEG, webcam", "quality 85", "webcam"), Flaw(PLAIN.replaced(jpeg_quality=WEBCAM.jpeg_quality))),
    (
        Row("H.264, key frames", "rate factor 23 (x264's default)", "`h264_crf`"),
        Flaw(PLAIN.replaced(h264_crf=23)),
    ),
    (
        Row("all of `webcam` but vignetting", "as above", ""),
        Flaw(WEBCAM.replaced(vignetting=0.0), as_linear=without_tone),
    ),
)


def by_formula(table: Table) -> list[tuple[Row, float]]:
    """Rows of effects on brightness alone, with PSNR."""
    power = float(np.mean(table.plain**2))
    mean = float(table.plain.mean())
    # A grain hides as much of the pupil as it covers of the beam, which is narrower at a mirror, over the blurred disc.
    beam_mm, disc_px = 1.8 * (1.0 - 100.0 / 500.0), 1360.0 * 1.8 * (1.0 / 100.0 - 1.0 / 500.0)
    hidden, covered = (0.2 / beam_mm) ** 2, 180 * np.pi / 4.0 * disc_px**2 / (1920 * 1080)
    return [
        (Row("exposure after the calibration", "5 % brighter", "no: [6]"), psnr_db(0.05**2 * power)),
        (Row("white balance after the calibration", "3 % in red", "no: [6]"), psnr_db(0.03**2 * power / 3.0)),
        (Row("mirrors unlike in reflectance", "2 % RMS", "`finish`"), psnr_db(0.02**2 * power)),
        (
            Row("scatter of the mirrors", "1 nm RMS: 0.05 % of the light", "`finish`"),
            psnr_db((5e-4 * mean) ** 2),
        ),
        (Row("dust", "20 grains of 0.2 mm a mirror", "no: [5]"), psnr_db(hidden**2 * covered * power)),
    ]


def cells(row: Row, effect: Effect | None, db: float) -> tuple[str, ...]:
    """A row of the table; what exceeds a tenth of the claimed figures is bold."""
    moved = ["0"] * 3
    if effect is not None:
        figures = (effect.corners_px, effect.normals_deg, effect.held_out_px)
        limits = (np.inf, max(PART * CLAIMED.normals_deg, ROUNDED_DEG), PART * CLAIMED.held_out_px)
        moved = [
            f"**{value:.4f}**" if value >= limit else f"{value:.4f}"
            for value, limit in zip(figures, limits, strict=True)
        ]
    limit_db = CLAIMED_DB - 20.0 * np.log10(PART)
    views = f"{db:.0f}" if db > limit_db else f"**{db:.0f}**"
    return row.effect, row.assumed, *moved, views, row.built


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_json_option(parser)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    table = Table(Setup(), SPP)
    rows = Rows("effect", "assumed", "corners px", "normals °", "held-out px", "views dB", "built")
    plain = table.setup.calibrated(table.setup.noisy(table.setup.true))
    for item in GEOMETRY:
        seen = item.seen(table.setup)
        found = table.setup.effect(seen, plain) if item.since_deg is None else table.setup.drift(seen, item.since_deg)
        rows.add(*cells(item.row, found, table.shifted_db(found.held_out_px)))
    in_pictures = effects(Setup(12, 6), {row.effect: flaw for row, flaw in PICTURES})
    for row, flaw in PICTURES:
        rows.add(*cells(row, in_pictures[row.effect], table.db(flaw)))
    for row, db in by_formula(table):
        rows.add(*cells(row, None, db))
    write_record(options.json, "idealisations", table=rows.table)
    print("\nFrom light to picture, one core, 1920 x 1080 of grey light:")
    rows = Rows("", "s")
    for name in SENSORS:
        rows.add(f"`{name}`", f"{frame_s(table.setup, SENSORS[name]):.3f}")
    c920 = frame_s(table.setup, C920)
    for field in sorted(set(SensorModel.model_fields) - {"jpeg_quality"}):
        if getattr(WEBCAM, field) != getattr(C920, field):
            more = frame_s(table.setup, C920.replaced(**{field: getattr(WEBCAM, field)})) - c920
            rows.add(f"`c920` with `{field}`", f"{more:+.3f}")
    write_record(options.json, "idealisations_seconds", table=rows.table)


if __name__ == "__main__":
    main()
