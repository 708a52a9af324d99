"""Write docs/measured.md from docs/measured.json: `python -m docs.make_measured`.

Benchmarks write the records: `python -m benchmarks.NAME --json docs/measured.json`. A line `record | figure | value` of
`TEMPLATE` becomes a row of a table. In its value, `{name:format}` is a value of the record, and `{row/column}` a cell
of the record's table, columns counted from 0 after the row's name. The command stands above a table with one source.
"""

from __future__ import annotations

import itertools
import string
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.records import ROOT, Record, Records
from mirrorcam.core.disk.files import write_text

RECORDS, PAGE = ROOT / "docs" / "measured.json", ROOT / "docs" / "measured.md"
HEAD = "| figure | value |\n|---|---|"
HEAD_WITH_SOURCES = "| figure | value | command | date, commit |\n|---|---|---|---|"

TEMPLATE = """\
# Measured figures

Each figure has the command that measured it, the date and the commit ("+": with uncommitted changes). `python -m
docs.make_measured` writes this page from [measured.json](measured.json), which the benchmarks write. Pictures are
rendered unless a row says "real"; [idealisations.md](idealisations.md) lists effects of real setups and their sizes.

## Default run

A device for a Logitech C920, seed 0, whose nine mirrors are tilted by 0.3° and shifted by 0.3 mm (standard deviations).
The sensor `webcam` has waves in the lens, a pupil that walks, colour fringes, a mosaic, noise and its reduction, a tone
curve, sharpening and MJPEG. A stated standard deviation is the largest that the calibration gives for any mirror. A
calibration with the right covariance exceeds a limit of the run's report once in a thousand runs.

default_run | grid error, in grid spacings | {design.grid_error:.3f}
default_run | usable share of the sensor at 300 mm | {design.usable_efficiency_300mm:.2f}
default_run | predicted standard deviation of depth at 300 mm | {design.depth_sigma_300mm:.2f} mm
default_run | rays blocked by parts | {cad.device.rays_blocked:.0f} of {cad.device.rays_cast:,.0f}
default_run | mass | {cad.device.mass_g:.0f} g
default_run | price of the parts, webcam included | {cad.device.price:.0f} EUR
default_run | printing time | {cad.device.print_minutes:,.0f} min
default_run | worst mirror normal against the truth | {validation.normal_error_max_deg:.4f}°
default_run | its stated standard deviation | {validation.normal_error_max_bound_deg:.4f}°
default_run | the same without the common rotation | {validation.normal_error_between_mirrors_max_deg:.4f}°
default_run | its stated standard deviation | {validation.normal_error_between_mirrors_max_bound_deg:.4f}°
default_run | worst mirror distance against the truth | {validation.distance_error_max_mm:.4f} mm
default_run | its stated standard deviation | {validation.distance_error_max_bound_mm:.4f} mm
default_run | held-out corners, RMS x / y | {validation.held_out_rms_x_px:.3f} / {validation.held_out_rms_y_px:.3f} px
default_run | held-out corners in space, RMS | {validation.held_out_spatial_rms_mm:.3f} mm
default_run | corners in decoded views, RMS | {validation.decoded_corner_rms_px:.3f} px

lateral_colour | decoded views: red and blue against green, RMS | {red_corrected:.2f}, {blue_corrected:.2f} grey levels
lateral_colour | the same, colours not aligned | {red_uncorrected:.2f}, {blue_uncorrected:.2f} grey levels

## A camera that obeys its model

The same device with the sensor `c920`: a lens of five coefficients, a fixed pupil, noise and JPEG, but no colour.

model_camera | worst mirror normal against the truth | {normal_error_max_deg:.4f}°
model_camera | worst mirror distance against the truth | {distance_error_max_mm:.3f} mm
model_camera | held-out corners, RMS x / y | {held_out_rms_x_px:.3f} / {held_out_rms_y_px:.3f} px
model_camera | held-out corners in space, RMS | {held_out_spatial_rms_mm:.3f} mm
model_camera | corners in decoded views, RMS | {decoded_corner_rms_px:.3f} px

## Calibration

NEES (normalised estimation error squared) is the squared error over the stated variance: 1 where the uncertainty is
right. The real photographs (by a phone) and the real video (of a board moved by hand) show a board in front of two
mirrors.

calibration_bound | NEES, 1000 trials with Gaussian noise | {NEES per degree of freedom/0}
calibration_start | converged fits of 500 from mirrors off by 2° and 2 mm | {converged_2deg:.0f}
calibration_photos | real photographs: reprojection, RMS x / y | {board bows in each photograph/0} px
calibration_photos | the same, mirrored corners held out | {board bows in each photograph/1} px
calibration_video | real video: reprojection, RMS x / y | {reprojection/0}

## Layouts of rectangles

Usable efficiency of mirrors 1 mm thick, as a percentage of that of free quadrilaterals, at the default fold or each at
its best. Mirrors are cut, or bought in the sizes of a list: one size for all, or any for each.

mirror_shapes | 3 x 3 mirrors, default fold: cut in 1 mm steps | {3x3_120.0_cut_percent:.0f} %
mirror_shapes | 3 x 3 mirrors, default fold: one size of a list | {3x3_120.0_one_size_percent:.0f} %
mirror_shapes | 3 x 3 mirrors, default fold: each of the list | {3x3_120.0_list_percent:.0f} %
mirror_shapes | 3 x 3 mirrors, best fold: cut in 1 mm steps | {3x3_auto_cut_percent:.0f} %
mirror_shapes | 3 x 3 mirrors, best fold: one size of a list | {3x3_auto_one_size_percent:.0f} %
mirror_shapes | 3 x 3 mirrors, best fold: each of the list | {3x3_auto_list_percent:.0f} %

## Sets of another renderer

The other renderer shares no code with this project.

calibration_foreign | ChArUco: worst normal, distance | {worst normal, distance/0}
calibration_foreign | ChArUco: NEES | {NEES per parameter/0}
calibration_foreign | checkerboard, often in part: worst normal, distance | {worst normal, distance/1}
calibration_foreign | checkerboard: NEES | {NEES per parameter/1}
calibration_foreign | 2 mm acrylic, second surface: worst normal, distance | {worst normal, distance/2}

## Other calibrators

RMS error of projected points, averaged over the sets that all calibrators solved; [leaderboard.md](leaderboard.md)
interprets the comparison. `sensor-webcam` is the set closest to a real webcam.

leaderboard | MirrorCam | {mirrorcam.rms_px:.3f} px
leaderboard | mrcal, one lens | {mrcal.rms_px:.3f} px
leaderboard | OpenCV, joint | {opencv-joint.rms_px:.3f} px
leaderboard_sets | `sensor-webcam`: MirrorCam | {mirrorcam.sensor-webcam:.3f} px
leaderboard_sets | `sensor-webcam`: mrcal, one lens | {mrcal.sensor-webcam:.3f} px
leaderboard_sets | `sensor-webcam`: OpenCV, joint | {opencv-joint.sensor-webcam:.3f} px
leaderboard | MirrorCam: NEES over all its sets, `sensor-webcam` included | {mirrorcam.nees:.2f}

## Light fields

Depth of scenes of the HCI 4D Light Field Benchmark, from 3 x 3 of its 9 x 9 views, and of other rendered scenes. The
reference is the truth where a row states it, else the disparity by EPINET, a neural network, from all views, which is
close to the truth except in the dark parts of `greek`. OpenCV's StereoSGBM is given the pair of views and the settings
that fit the reference best. Errors are the benchmark's: BadPix.07, the percentage of pixels off by more than 0.07 px,
and MSE, the mean squared error times 100.

light_field_depth_scenes | `cotton`: BadPix.07, MSE | {cotton_step4/1}
light_field_depth_scenes | `cotton`, StereoSGBM | {cotton_step4/2}
light_field_depth_scenes | `dino`: BadPix.07, MSE | {dino_step4/1}
light_field_depth_scenes | `dino`, StereoSGBM | {dino_step4/2}
light_field_depth_scenes | `greek`: BadPix.07, MSE | {greek_step4/1}
light_field_depth_scenes | `greek`, StereoSGBM | {greek_step4/2}
light_field_depth_scenes | `antinous` (truth): BadPix.07, MSE | {antinous/1}
light_field_depth_scenes | `antinous`, StereoSGBM | {antinous/2}
light_field_depth_scenes | `slant` of our own, seed 4 (truth): BadPix.07, MSE | {slant4/1}
light_field_depth_scenes | `slant`, StereoSGBM | {slant4/2}
light_field_depth_scenes | `rods` of our own, seed 2 (truth): BadPix.07, MSE | {rods2/1}
light_field_depth_scenes | `rods`, StereoSGBM | {rods2/2}
light_field_depth_scenes | bare office, noise of 20 (truth): BadPix.07, MSE | {office/1}
light_field_depth_scenes | bare office, StereoSGBM | {office/2}

Confidence and standard deviation on scenes that were not used in training, in this order: mean confidence; fraction of
[right depths](theory.md#depth-and-its-errors); mean difference of both over ten classes of confidence, averaged over
cases; and fraction of all errors beyond three standard deviations. `noise` adds white noise of 5 and 20 grey levels;
`photographed` simulates lens, sensor and processing of three webcams, and `wide range` searches such pictures over five
times the range; `wrong range` searches two fifths of it, so that most true depths are outside; `wrong order` exchanges
views, and `few views` keeps two to four of them.

light_field_depth_confidence | rendered | {rendered/0}; {rendered/1}; {rendered/2}; {rendered/3}
light_field_depth_confidence | noise | {noise/0}; {noise/1}; {noise/2}; {noise/3}
light_field_depth_confidence | photographed | {photographed/0}; {photographed/1}; {photographed/2}; {photographed/3}
light_field_depth_confidence | wide range | {wide range/0}; {wide range/1}; {wide range/2}; {wide range/3}
light_field_depth_confidence | wrong range | {wrong range/0}; {wrong range/1}; {wrong range/2}; {wrong range/3}
light_field_depth_confidence | wrong order | {wrong order/0}; {wrong order/1}; {wrong order/2}; {wrong order/3}
light_field_depth_confidence | few views | {few views/0}; {few views/1}; {few views/2}; {few views/3}
light_field_depth_confidence | real pair | {real pair/0}; {real pair/1}; {real pair/2}; {real pair/3}
light_field_depth_confidence | bare walls | {bare walls/0}; {bare walls/1}; {bare walls/2}; {bare walls/3}

Time of a depth map, ms: alone; as a frame of a video with `--fast`; by StereoSGBM from one pair. Each is the processor
time with one thread / the wall time with two, in brackets the processor time relative to the pair's. Rows are views,
pixels of a view, and planes of depth searched.

light_field_depth_speed | 3x3, 400x240, 114 | {3x3, 400x240, 114/0}; {3x3, 400x240, 114/2}; {3x3, 400x240, 114/3}
light_field_depth_speed | 3x3, 200x120, 58 | {3x3, 200x120, 58/0}; {3x3, 200x120, 58/2}; {3x3, 200x120, 58/3}
light_field_depth_speed | 3x3, 800x480, 226 | {3x3, 800x480, 226/0}; {3x3, 800x480, 226/2}; {3x3, 800x480, 226/3}
light_field_depth_speed | 2x2, 400x240, 112 | {2x2, 400x240, 112/0}; {2x2, 400x240, 112/2}; {2x2, 400x240, 112/3}
light_field_depth_speed | 5x5, 400x240, 109 | {5x5, 400x240, 109/0}; {5x5, 400x240, 109/2}; {5x5, 400x240, 109/3}
light_field_depth_speed | 9x9, 400x240, 109 | {9x9, 400x240, 109/0}; {9x9, 400x240, 109/2}; {9x9, 400x240, 109/3}
light_field_depth_speed | 3x3, 400x240, 58 | {3x3, 400x240, 58/0}; {3x3, 400x240, 58/2}; {3x3, 400x240, 58/3}
light_field_depth_speed | 3x3, 400x240, 226 | {3x3, 400x240, 226/0}; {3x3, 400x240, 226/2}; {3x3, 400x240, 226/3}

decode | frames of the default layout decoded per second | {decode_hz:.0f}
decode | time relative to `cv2.remap` of the same tables | {times_remap:.2f}
decode | the same with the pupil of the lens | {lens_times_remap:.2f}
decode | the same with equalised views | {equalised_times_remap:.2f}

## Robustness and motion

Detected frames, views and corners of boards that are partly hidden:

detection_parts | entire boards | {nothing more/2}
detection_parts | only the middle of each view visible | {all but the middle of each view/2}
detection_parts | corners off by more than 1 px, the last case | {all but the middle of each view/3}

light_field_motion_mirrors | camera on a loop of 0.5 m: drift | {mirrors, loop 0/1}
light_field_motion_mirrors | the same by OpenCV's StereoSGBM and PnP | {mirrors, loop 0/6}

## Measured once

The scripts are in the history of the repository, up to commit b9e55788167a.

- **Blind sets of the reference renderer.** Worst normal 0.0006° with first-surface mirrors, and 0.0007° with 2 mm of
  acrylic, whose thickness is found within 0.004 mm.
- **Hard pictures** (three frames, JPEG 25, overexposure by 1.8, blur of 2.5 px, hidden boards) of the sets of another
  renderer: worst normal 0.010°; one overexposed set is rejected by the verdict.
- **The optimiser** solved all 70 specifications with various counts, scales, depths, gaps, cameras and surfaces.
- **All files of a device** are built in 25 s for 3 x 3 mirrors and in 26 s for 5 x 5, on two cores.
- **Features** of tabletop scenes: 98.7 % of ORB's and 99.7 % of AKAZE's are within 2 % of the true depth, against
  72.2 % and 87.6 % for pairwise matches with the ratio test.
- **Refocused pictures** of a C920 agree to 37 to 41 dB with a pinhole's picture of the plane in focus.
- **The pupil in decoding**: views agree with the truth to 38.9 dB, against 36.3 dB for a pinhole model, and seams of
  refocused pictures are 0.1 to 0.3 grey levels, against 2.0 to 3.2.
- **Views interpolated between 3 x 3**: refocused pictures agree with those of 9 x 9 views to 47 to 69 dB, against 33
  to 43 dB.
- **`refocus --scale 2`** resolves 0.98 line pairs per pixel of nine ideal views, against 0.54 in the central view; for
  decoded frames of the mirror camera 0.46, against 0.44.
- **Filters**: at noise of 25 grey levels, the hyperfan gives 29 to 41 dB, non-local means of the central view 26 to
  37 dB.
- **Depth of videos**, filtered in time: the flicker of a still scene falls from 0.34 to 0.11 px, BadPix from 29 to
  12 %.
- **Depth of a tabletop scene** at 300 to 500 mm: median error 0.04 %, 90th percentile 0.4 %.

## Time

On two cores without a GPU; other programs ran at the same time as the calibrations.

leaderboard | calibration of one set of the leaderboard | {MirrorCam/8} s
suite_scale | rendering 200 small sets, one of two workers killed | {elapsed_s:.0f} s
"""


class _Names(string.Formatter):
    """Formats `{design.grid_error:.3f}` by the complete name, without attributes."""

    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> tuple[Any, str]:
        return kwargs[field_name], field_name


def table(lines: Sequence[str], records: Records) -> str:
    """The table of consecutive lines of the template."""
    rows, sources = [], []
    for line in lines:
        key, figure, text = line.split(" | ")
        record = records.records[key]
        rows.append(f"| {figure} | {_Names().vformat(text, (), _fields(record))} |")
        sources.append((f"`{record.command}`", f"{record.date}, {record.commit}{'+' * record.changed}"))
    if len({*sources}) == 1:
        command, when = sources[0]
        return "\n".join([f"{command} ({when}):\n", HEAD, *rows])
    with_sources = (f"{row} {command} | {when} |" for row, (command, when) in zip(rows, sources, strict=True))
    return "\n".join([HEAD_WITH_SOURCES, *with_sources])


def _fields(record: Record) -> dict[str, float | str]:
    cells = () if record.table is None else record.table.rows
    texts = {f"{name}/{column}": cell for name, *others in cells for column, cell in enumerate(others)}
    return {name: item.value for name, item in record.values.items()} | texts


def page(records: Records) -> str:
    """The page; consecutive lines with values become one table."""
    parts = itertools.groupby(TEMPLATE.split("\n"), key=lambda line: " | " in line)
    return "\n".join(table([*lines], records) if is_table else "\n".join(lines) for is_table, lines in parts)


if __name__ == "__main__":
    write_text(PAGE, page(Records.load(RECORDS)))
