"""Speed of previews of a design: `python -m benchmarks.studio_preview [--layouts FILE...] [--rounds N]`.

For each layout (by default designs of several counts and scales), in one warm process: median and 95th percentile for a
preview of the tabletop and of a board, 640 px wide, in elapsed and processor seconds (which other work on the machine
affects less), and for its products: decoded views with a depth map, and a refocused picture. If Mitsuba is installed,
also the reference's picture of the same objects in the same size, on all cores, and the errors of the preview: the
percentage of pixels that show a different object, the median and the 99th percentile of depth errors, and the
correlation of the two pictures. The first call of the process, which loads machine code and draws textures, is timed
separately.
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
from mirrorcam.render_scenes.preview.products import preview_products

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
    """Medians and 95th percentiles of the seconds of a job: elapsed (`clock`) and processor time."""

    clock: float
    clock_95: float
    processor: float
    processor_95: float

    def __str__(self) -> str:
        return (
            f"p50 {self.clock:.3f} p95 {self.clock_95:.3f} s (processor {self.processor:.3f}, {self.processor_95:.3f})"
        )


def times_s(job: Callable[[], object], rounds: int) -> Times:
    """Time a job repeatedly."""
    times = []
    for _ in range(rounds):
        start_s = time.perf_counter(), time.process_time()
        job()
        times.append((time.perf_counter() - start_s[0], time.process_time() - start_s[1]))
    (clock, processor), (clock_95, processor_95) = np.percentile(times, [50.0, 95.0], axis=0)
    return Times(float(clock), float(clock_95), float(processor), float(processor_95))


@dataclass(frozen=True)
class Comparison:
    """A preview compared with the reference in the same size."""

    build_s: float
    four_samples_s: float
    many_samples_s: float
    other_percent: float
    median_mm: float
    p99_mm: float
    correlation: float

    def __str__(self) -> str:
        return (
            f"reference {self.build_s:.2f} s to build, {self.four_samples_s:.2f} s at 4 and {self.many_samples_s:.2f} "
            f"s at {REFERENCE_SPP} samples; other object {self.other_percent:.3f} % of pixels, depth error "
            f"{self.median_mm:.1g} mm, 99 % within {self.p99_mm:.1g}, correlation {self.correlation:.3f}"
        )


def compare(frame: PreviewFrame) -> Comparison:
    """Compare a preview of the tabletop with the reference in the same size, and time the reference."""
    from mirrorcam.render_scenes.tabletop.tabletop_scene import NOTHING, TabletopScene
    from mirrorcam.render_scenes.truth.pixel_maps import pixel_rays

    layout, light = frame.layout, frame.light
    pupil = layout.camera.pupil
    start_s = time.perf_counter()
    scene = TabletopScene(layout, arranged_tabletop(layout, 0), REFLECTANCE)
    built = time.perf_counter()
    scene.photograph(pupil, spp=1, subpixels=2, seed=0)
    four = time.perf_counter()
    radiance = scene.photograph(pupil, spp=REFERENCE_SPP, subpixels=1, seed=0)
    many = time.perf_counter()
    rays = pixel_rays(layout, mirrors=True)
    hits = scene.hits(rays.start, rays.direction)
    same_mirror = (hits.object_index != NOTHING) & (rays.mirror == light.mirror)
    same = same_mirror & (hits.object_index == light.object_number)
    error = np.abs(hits.points[same] @ layout.view_from_rig[2] - light.depth_mm[same])
    grey = [np.clip(picture, 0.0, 1.0).mean(axis=2).ravel() for picture in (radiance, light.radiance)]
    return Comparison(
        build_s=built - start_s,
        four_samples_s=four - built,
        many_samples_s=many - four,
        other_percent=100.0 * float(1.0 - same.sum() / same_mirror.sum()),
        median_mm=float(np.median(error)),
        p99_mm=float(np.percentile(error, 99.0)),
        correlation=float(np.corrcoef(*grey)[0, 1]),
    )


def main(layouts: dict[str, Layout], rounds: int = ROUNDS, json: Path | None = None) -> int:
    """Print the figures; return 1 if previews of the tabletop via 3 x 3 mirrors take too much processor time."""
    late = False
    figures: dict[str, float] = {}
    correlations = []
    has_mitsuba = importlib.util.find_spec("mitsuba") is not None
    for number, (name, layout) in enumerate(layouts.items()):
        start_s = time.perf_counter()
        frame = preview_frame(layout)
        if number == 0:
            print(f"first call of the process: {time.perf_counter() - start_s:.2f} s")
        for subject in ("tabletop", "board"):
            times = times_s(partial(preview_frame, layout, subject), rounds)
            print(f"{name:15} {subject:8} {times}")
            late |= subject == "tabletop" and layout.rows * layout.cols == 9 and times.processor_95 > LIMIT_S
            figures.setdefault(f"{subject}_s", times.processor)
        products = preview_products(frame)
        middle = default_reference_depth_mm(layout)
        views, focused = (
            times_s(partial(preview_products, frame), rounds),
            times_s(partial(products.refocused, middle), rounds),
        )
        print(f"{name:15} views and depth {views}")
        print(f"{name:15} refocusing {focused}")
        figures = {"views_s": views.processor, "focused_ms": 1e3 * focused.processor} | figures
        size = "x".join(map(str, products.light_field.samples.shape[3:1:-1]))
        print(f"{'':15} views of {size} px, depth error {products.median_error_mm:.2g} mm (median)")
        if has_mitsuba:
            comparison = compare(frame)
            print(f"{'':15} {comparison}")
            correlations.append(comparison.correlation)
            figures = {
                "depth_mm": comparison.p99_mm,
                "reference_s": comparison.four_samples_s,
                "reference_scene_s": comparison.build_s,
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
    options = parser.parse_args()
    layouts = {path.stem: Layout.load(path) for path in options.layouts or ()}
    raise SystemExit(
        main(layouts or {name: design(spec) for name, spec in SPECS.items()}, options.rounds, options.json)
    )
