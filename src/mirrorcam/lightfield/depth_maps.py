"""Depth maps of light fields as files: estimate, draw, and reuse them for the same light field."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder, results_folder
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.core.images.pfm import write_pfm
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, RecordingFilter
from mirrorcam.lightfield.requests import DepthRequest
from mirrorcam.optics.light_field.depth import DepthEstimator, DepthMap, Quality
from mirrorcam.optics.light_field.depth.depth_files import DepthRecord, content_digest, load_depth, save_depth
from mirrorcam.optics.light_field.light_field import LightField

MIN_CONFIDENCE = 0.5
"""Confidence above which a depth counts as confident."""
ENDINGS = ("depth.npz", "depth.pfm", "depth.png")
CODE = "mirrorcam.optics.light_field.depth.video"
"""Module whose code determines the depth."""
_SHA256, _SEARCHED = "sha256", "searched_mm"
WIDTH_IN, TITLE_IN = 15.0, 0.5
TICKS = 7


@dataclass(frozen=True)
class DepthSummary:
    """Depth of one light field: fractions of pixels with a depth and with a confident depth, and the latter's median.

    The median is NaN if no depth is confident.
    """

    name: str
    depth_fraction: float
    confident_fraction: float
    median_mm: float


def write_depths(
    inputs: LightFieldInputs,
    folder: Path,
    request: DepthRequest = DepthRequest(),
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[DepthSummary]:
    """Estimate the depth of light fields; frames of a recording are first averaged in time, unless `frames_apart`.

    Writes NAME_depth.npz, .pfm and .png into a folder; `force` also replaces files that it did not write.
    """
    estimator: DepthEstimator | None = None
    recording = RecordingFilter()
    summaries = []
    with output_folder(folder, "depth", force=force) as output:
        for named in inputs.open_for(output, ENDINGS, progress):
            if estimator is None or not estimator.fits(named.light_field):
                near, far = named.depths_to_search(request.near_mm, request.far_mm)
                quality: Quality = "fast" if request.fast else "best"
                estimator = DepthEstimator(named.light_field, near_mm=near, far_mm=far, quality=quality)
            depth = estimator.estimate(named.light_field if request.frames_apart else recording.filtered(named))
            searched_mm = estimator.near_mm, estimator.far_mm
            with output.staged(complete=False, result=f"{named.name}_depth.pfm") as staged:
                write_depth(staged, named.name, depth, named.light_field, searched_mm)
                write_pfm(staged / f"{named.name}_depth.pfm", depth.depth_mm)
                draw_depth(staged / f"{named.name}_depth.png", named.light_field, depth)
            record_depth(output, named.name, named.light_field, searched_mm)
            confident = depth.valid & (depth.confidence > MIN_CONFIDENCE)
            median = float(np.median(depth.depth_mm[confident])) if confident.any() else np.nan
            summaries.append(DepthSummary(named.name, float(depth.valid.mean()), float(confident.mean()), median))
    return summaries


@dataclass(frozen=True, eq=False)
class StoredDepth:
    """A stored depth map: its file, depth (v, u) in mm, and nearest and farthest depth of the search in mm."""

    path: Path
    depth_mm: NDArray[np.float32]
    searched_mm: tuple[float, float]


def write_depth(
    folder: Path, name: str, depth: DepthMap, light_field: LightField, searched_mm: tuple[float, float]
) -> None:
    """Write a depth map as NAME_depth.npz, with the digest of its light field and the depth range of its search."""
    save_depth(folder / f"{name}_depth.npz", depth, DepthRecord(content_digest(light_field), searched_mm))


def record_depth(output: OutputFolder, name: str, light_field: LightField, searched_mm: tuple[float, float]) -> None:
    """Record in the store of a folder the light field and search range of its NAME_depth.npz."""
    contents = {_SHA256: file_digest(output.path / f"{name}_depth.npz"), _SEARCHED: " ".join(map(str, searched_mm))}
    output.results.put(
        f"depth-{name}", _provenance(light_field), {key: text.encode() for key, text in contents.items()}
    )


def stored_depth(
    folder: Path, name: str, light_field: LightField, near_mm: float | None, far_mm: float | None
) -> StoredDepth | None:
    """Load NAME_depth.npz of a folder if this program measured it in this light field; else None.

    A nearest or farthest depth, if given, must equal that of its search.
    """
    contents = Results(results_folder(folder)).get(f"depth-{name}", _provenance(light_field))
    if contents is None:
        return None
    path, (near, far) = folder / f"{name}_depth.npz", map(float, contents[_SEARCHED].split())
    if near_mm not in (None, near) or far_mm not in (None, far):
        return None
    if not path.is_file() or file_digest(path) != contents[_SHA256].decode():
        return None
    return StoredDepth(path, load_depth(path, light_field), (near, far))


def _provenance(light_field: LightField) -> dict[str, str]:
    return {"light_field": content_digest(light_field)} | program_of(CODE)


def draw_depth(path: Path, light_field: LightField, depth: DepthMap) -> None:
    """Write the figure as PNG, atomically; colours are linear in inverse depth: equal steps are equal disparities."""
    samples = light_field.samples[depth.view]
    view = np.broadcast_to(samples, (*samples.shape[:2], 3))
    inverse_depth = 1.0 / depth.depth_mm
    confident = depth.confidence > MIN_CONFIDENCE
    samples = inverse_depth[confident if confident.any() else depth.valid]
    low, high = (float(edge) for edge in np.quantile(samples, (0.005, 0.995))) if samples.size else (0.0, 1.0)
    height_in = WIDTH_IN / 3.0 * view.shape[0] / view.shape[1] + TITLE_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    axes[0].imshow(view)
    depth_image = axes[1].imshow(
        _masked(inverse_depth, depth.valid), cmap="turbo", vmin=low, vmax=high, interpolation="nearest"
    )
    confidence_image = axes[2].imshow(_masked(depth.confidence, depth.valid), cmap="viridis", vmin=0.0, vmax=1.0)
    ticks = np.linspace(low, high, TICKS)
    bar = figure.colorbar(depth_image, ax=axes[1], ticks=ticks, fraction=0.03, pad=0.02)
    bar.ax.set_yticklabels([f"{1.0 / tick:.0f}" if tick > 0 else "∞" for tick in ticks])
    figure.colorbar(confidence_image, ax=axes[2], fraction=0.03, pad=0.02)
    for panel, title in zip(axes, ("view", "depth from the pupil, mm", "confidence"), strict=True):
        panel.set_title(title)
        panel.set_axis_off()
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})


def _masked(values: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    return np.where(valid, values, np.float32(np.nan))
