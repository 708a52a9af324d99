"""Files of the ground truth of a rendered set."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.core.disk.files import write_bytes, write_json, write_npz
from mirrorcam.core.values import FloatArray
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.sets.poses import PosePlan
from mirrorcam.render_scenes.truth.corners import Oracle
from mirrorcam.render_scenes.truth.pixel_maps import exr_bytes
from mirrorcam.render_scenes.truth.pupil_maps import PupilTracer, pupil_maps


def write_truth(
    out: Path,
    oracle: Oracle,
    finishes: tuple[MirrorFinish, ...],
    moments: FloatArray,
    base_plan: PosePlan,
    seed: int,
) -> None:
    """Write the ground truth of a set, which only a validation may read."""
    halfway = moments[:, moments.shape[1] // 2]
    truth = out / "truth"
    frames_px, frames_visible = oracle.all_by_mirrors(list(moments))
    base_px, base_visible = oracle.all_direct(list(base_plan.poses))
    oracle.layout.save(truth / "layout.json")
    write_json(truth / "poses.json", {"frames": halfway.tolist(), "base": base_plan.poses.tolist()})
    if moments.shape[1] == 3:
        write_json(truth / "readout.json", {"poses": moments.tolist()})
    if finishes:
        write_json(truth / "finish.json", {"mirrors": [finish.model_dump(mode="json") for finish in finishes]})
    write_json(truth / "seed.json", {"seed": seed})
    corners = {
        "frames_px": frames_px,
        "frames_visible": frames_visible,
        "base_px": base_px,
        "base_visible": base_visible,
    }
    write_npz(truth / "corners.npz", corners)


def write_pupil_maps(path: Path, tracer: PupilTracer) -> None:
    """Write the maps of the parts of the pupil that mirrors serve, which all frames share."""
    pupil = tracer.pupil
    header = {"layout": tracer.layout.identity, "units": "mm"}
    header |= {"aperture_mm": repr(pupil.aperture_mm), "focus_mm": repr(pupil.focus_mm)}
    write_bytes(path, exr_bytes(pupil_maps(tracer), header))
