"""Speed of previews of a design: `python -m benchmarks.studio_preview [--layouts FILE...] [--rounds N]`.

For each layout (by default those designed for some counts and scales), in one warm process: median and 95th percentile
of a preview of the tabletop and of a board, 640 px wide, in seconds of the clock and of one processor (which other work
on the machine changes less), and of what is had of it: decoded views with a depth map, and a picture focused on a
depth. Beside it, where Mitsuba is installed, the reference's picture of the same objects at the same size, by as many
cores as there are, and how far off the preview is: the share of pixels that show another object, the median and the
99th percentile of errors of depth, and the correlation of the two pictures. The first call of the process, which loads
machine code and draws textures, is timed by itself.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.records import add_json_option, write_record
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import default_reference_depth_mm
from mirrorcam.render_scenes.preview.preview_frame import REFLECTANCE, PreviewFrame, arranged_tabletop, preview_frame
from mirrorcam.render_scenes.preview.seen_by import seen_in

ROUNDS = 20
LIMIT_S = 0.3
REFERENCE_SPP = 16
SPECS = {
    "3x3": DesignSpec(),
    "5x5": DesignSpec(rows=5, cols=5),
    "2x3": DesignSpec(rows=2, cols=3),
    "3x3, scale 40": DesignSpec(scale_mm=40.0),
    "3x3, scale 160": DesignSpec(scale_mm=160.0),
    "3x3, plates": DesignSpec(surface="second", thickness_mm=2.0),
}


@dataclass(frozen=True)
class Times:
    """Medians and 95th percentiles of the seconds of a job, by the clock and by the processor."""

    clock: float
    clock_95: float
    processor: float
    processor_95: float

    def __str__(self) -> str:
        return (
            f"p50 {self.clock:.3f} p95 {self.clock_95:.3f} s (processor {self.processor:.3f}, {self.processor_95:.3f})"
        )


def times_s(job: Callable[[], object], rounds: int) -> Times:
    """How long a job takes."""
    times = []
    for _ in range(rounds):
        started = time.perf_counter(), time.process_time()
        job()
        times.append((time.perf_counter() - started[0], time.process_time() - started[1]))
    (clock, processor), (clock_95, processor_95) = np.percentile(times, [50.0, 95.0], axis=0)
    return Times(float(clock), float(clock_95), float(processor), float(processor_95))


@dataclass(frozen=True)
class Compared:
    """A preview beside the reference at the same size."""

    build_s: float
    four_samples_s: float
    many_samples_s: float
    other_percent: float
    median_mm: float
    most_mm: float
    correlation: float

    def __str__(self) -> str:
        return (
            f"reference {self.build_s:.2f} s to build, {self.four_samples_s:.2f} s at 4 and {self.many_samples_s:.2f} "
            f"s at {REFERENCE_SPP} samples; other object {self.other_percent:.3f} % of pixels, depth off by "
            f"{self.median_mm:.1g} mm, 99 % within {self.most_mm:.1g}, correlation {self.correlation:.3f}"
        )


def of_reference(frame: PreviewFrame) -> Compared:
    """How a preview of the tabletop compares with the reference at the same size, and how long that takes."""
    from mirrorcam.render_scenes.tabletop.tabletop_scene import NOTHING, TabletopScene
    from mirrorcam.render_scenes.truth.pixel_maps import pixel_rays

    layout, light = frame.layout, frame.light
    pupil = layout.camera.pupil
    started = time.perf_counter()
    scene = TabletopScene(layout, arranged_tabletop(layout, 0), REFLECTANCE)
    built = time.perf_counter()
    scene.photograph(pupil, spp=1, subpixels=2, seed=0)
    four = time.perf_counter()
    radiance = scene.photograph(pupil, spp=REFERENCE_SPP, subpixels=1, seed=0)
    many = time.perf_counter()
    rays = pixel_rays(layout, mirrors=True, pupil=pupil)
    hits = scene.hits(rays.start, rays.direction)
    both = (hits.object_index != NOTHING) & (rays.mirror == light.mirror)
    same = both & (hits.object_index == light.thing)
    error = np.abs(hits.points[same] @ layout.view_from_rig[2] - light.depth_mm[same])
    grey = [np.clip(picture, 0.0, 1.0).mean(axis=2).ravel() for picture in (radiance, light.radiance)]
    return Compared(
        build_s=built - started,
        four_samples_s=four - built,
        many_samples_s=many - four,
        other_percent=100.0 * float(1.0 - same.sum() / both.sum()),
        median_mm=float(np.median(error)),
        most_mm=float(np.percentile(error, 99.0)),
        correlation=float(np.corrcoef(*grey)[0, 1]),
    )


def main(layouts: dict[str, Layout], rounds: int = ROUNDS, json: Path | None = None) -> int:
    """Print the figures; 1 where previews of the tabletop by 3 x 3 mirrors take more of a processor than they may."""
    late = False
    figures: dict[str, float] = {}
    correlations = []
    has_mitsuba = importlib.util.find_spec("mitsuba") is not None
    for number, (name, layout) in enumerate(layouts.items()):
        started = time.perf_counter()
        frame = preview_frame(layout)
        if number == 0:
            print(f"first call of the process: {time.perf_counter() - started:.2f} s")
        for subject in ("tabletop", "board"):
            taken = times_s(partial(preview_frame, layout, subject), rounds)
            print(f"{name:15} {subject:8} {taken}")
            late |= subject == "tabletop" and layout.rows * layout.cols == 9 and taken.processor_95 > LIMIT_S
            figures.setdefault(f"{subject}_s", taken.processor)
        seen = seen_in(frame)
        middle = default_reference_depth_mm(layout)
        views, focused = times_s(partial(seen_in, frame), rounds), times_s(partial(seen.refocused, middle), rounds)
        print(f"{name:15} views and depth {views}")
        print(f"{name:15} refocusing {focused}")
        figures = {"views_s": views.processor, "focused_ms": 1e3 * focused.processor} | figures
        size = "x".join(map(str, seen.light_field.samples.shape[3:1:-1]))
        print(f"{'':15} views of {size} px, depth off by {seen.median_error_mm:.2g} mm (median)")
        if has_mitsuba:
            against = of_reference(frame)
            print(f"{'':15} {against}")
            correlations.append(against.correlation)
            figures = {
                "depth_mm": against.most_mm,
                "reference_s": against.four_samples_s,
                "reference_scene_s": against.build_s,
            } | figures
    if correlations:
        figures |= {"correlation_least": min(correlations), "correlation_most": max(correlations)}
        write_record(json, "studio_preview", figures | {"pixels_percent": 99})
    return int(late)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", type=Path, nargs="+", metavar="FILE", help="layouts instead of designed ones")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    add_json_option(parser)
    asked = parser.parse_args()
    given = {path.stem: Layout.load(path) for path in asked.layouts or ()}
    raise SystemExit(main(given or {name: design(spec) for name, spec in SPECS.items()}, asked.rounds, asked.json))
