"""A synthetic calibration set: what a real user would photograph, with the truth in a folder of its own.

A set follows from its request (layout, board, counts, seed, tolerances, settings): the same request, the same bytes.
Every file is written whole or not at all, so an interrupted set is continued where it stopped.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from optics.as_built import draw_as_built
from optics.files import atomic, write_image, write_json
from optics.layout import Layout
from optics.targets import Charuco, Checkerboard, save_board
from optics.tolerances import Tolerances
from optics.values import FloatArray, InputError
from render_scenes.dataset import MANIFEST, Dataset, RenderSettings, sha256
from render_scenes.llvm import use_variant
from render_scenes.photograph import photograph
from render_scenes.poses import Plan, plan_base_frames, plan_frames
from render_scenes.scene import BoardScene
from render_scenes.truth import Oracle

# Streams of random numbers; each is independent of how much the others draw.
_AS_BUILT, _POSES, _BASE_POSES, _FRAMES, _BASE = range(5)


def render_set(
    layout: Layout,
    target: Checkerboard | Charuco,
    out: Path,
    *,
    frames: int,
    base_frames: int,
    seed: int,
    tolerances: Tolerances,
    spp: int = 16,
    settings: RenderSettings | None = None,
    on_frame: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Render frames through an as-built copy of `layout` and frames of its bare camera into `out`.

    Finished frames of an interrupted run with the same request are kept. `on_frame(done, total)` is called once at the
    start and after each frame. Raises InputError where Mitsuba is missing, the board cannot be seen, the tolerances
    cannot be built, or `out` holds another set.
    """
    variant = use_variant()
    settings = (settings or RenderSettings()).replaced(spp=spp)
    built = draw_as_built(layout, tolerances, _random(seed, _AS_BUILT))
    plan = plan_frames(layout, target, frames, _random(seed, _POSES))
    base_plan = plan_base_frames(layout, target, base_frames, _random(seed, _BASE_POSES))
    dataset = Dataset(
        layout_identity=layout.identity,
        target=target,
        frames=frames,
        base_frames=base_frames,
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        tolerances=tolerances,
        settings=settings,
        renderer=f"mitsuba {metadata.version('mitsuba')} {variant}",
        coverage=tuple(plan.coverage),
        base_coverage=float(base_plan.coverage[0]),
        request="",
    )
    dataset = dataset.replaced(request=_digest(dataset, built, plan, base_plan, seed))
    # Before anything is written: a scene refuses what it cannot render.
    scene, base_scene = (BoardScene(built.camera, mirrors, target, settings) for mirrors in (built.mirrors, ()))
    dataset = _continue(out, dataset)
    dataset = _write_known(out, dataset, layout, target)
    dataset = _write_truth(out, dataset, built, target, plan, base_plan, seed)
    total = frames + base_frames
    kept = sum(name in dataset.files for name in (*dataset.frame_names, *dataset.base_names))
    report = on_frame or (lambda done, of: None)
    report(kept, total)
    for stream, stage, names, poses in (
        (_FRAMES, scene, dataset.frame_names, plan.poses),
        (_BASE, base_scene, dataset.base_names, base_plan.poses),
    ):
        for index, name in enumerate(names):
            if name not in dataset.files:
                write_image(out / name, _picture(stage, poses[index], settings, seed, stream, index))
                dataset = _recorded(out, dataset, name)
                kept += 1
                report(kept, total)
    return dataset


def _random(*key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(key))


def _picture(
    scene: BoardScene, rig_from_board: FloatArray, settings: RenderSettings, seed: int, stream: int, index: int
) -> NDArray[np.uint8]:
    """One frame; its samples and its noise depend on nothing but the seed and its place in the set."""
    key = np.random.SeedSequence((seed, stream, index))
    scene.place_board(rig_from_board)
    cut = settings.subpixels
    radiance = scene.render(spp=settings.spp // cut**2, seed=int(key.generate_state(1)[0]), subpixels=cut)
    return photograph(radiance, cut, settings.sensor, np.random.default_rng(key.spawn(1)[0]))


def _digest(dataset: Dataset, built: Layout, plan: Plan, base_plan: Plan, seed: int) -> str:
    """Sixteen hexadecimal digits of all that the bytes of a set follow from."""
    asked = dataset.model_dump(mode="json", exclude={"request", "files"})
    drawn = {"seed": seed, "built": built.identity, "poses": [plan.poses.tolist(), base_plan.poses.tolist()]}
    return hashlib.sha256(json.dumps(asked | drawn, sort_keys=True).encode()).hexdigest()[:16]


def _continue(out: Path, dataset: Dataset) -> Dataset:
    """The manifest to go on with: that of an interrupted run of the same request, less what is not intact."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file, expected a folder for the set")
    if not (out / MANIFEST).exists():
        strangers = sorted(name for name in ("frames", "base", "truth") if (out / name).exists())
        if strangers:
            raise InputError(f"{out}: has a folder {strangers[0]!r} but no {MANIFEST}, expected a new or empty folder")
        dataset.save(out)
        return dataset
    before = Dataset.load(out)
    if before.request != dataset.request:
        asked = set(Dataset.model_fields) - {"schema_id", "request", "files", "coverage", "base_coverage"}
        other = sorted(name for name in asked if getattr(before, name) != getattr(dataset, name))
        differs = " and ".join(other) or "seed (or of another version of this program)"
        raise InputError(f"{out}: holds a set of another {differs}, expected the same request or a new folder")
    # A killed run cannot remove its temporary files (`optics.files.atomic`).
    for pattern in ("frames/.*-*.png", "base/.*-*.png", "truth/.*-*.*", ".*-*.json", ".*-*.toml"):
        for leftover in out.glob(pattern):
            leftover.unlink()
    return before.replaced(files={name: digest for name, digest in before.files.items() if before.intact(out, name)})


def _recorded(out: Path, dataset: Dataset, *names: str) -> Dataset:
    """The manifest with the checksums of files just written, saved."""
    dataset = dataset.replaced(files=dataset.files | {name: sha256(out / name) for name in names})
    dataset.save(out)
    return dataset


def _write_known(out: Path, dataset: Dataset, layout: Layout, target: Checkerboard | Charuco) -> Dataset:
    """What the user knows besides the pictures."""
    layout.save(out / "layout.json")
    save_board(out / "board.toml", target)
    return _recorded(out, dataset, "layout.json", "board.toml")


def _write_truth(
    out: Path,
    dataset: Dataset,
    built: Layout,
    target: Checkerboard | Charuco,
    plan: Plan,
    base_plan: Plan,
    seed: int,
) -> Dataset:
    """What only a validation may read."""
    truth = out / "truth"
    oracle = Oracle(built, target)
    frames_px, frames_visible = oracle.all_by_mirrors(list(plan.poses))
    base_px, base_visible = oracle.all_direct(list(base_plan.poses))
    built.save(truth / "layout.json")
    write_json(truth / "poses.json", {"frames": plan.poses.tolist(), "base": base_plan.poses.tolist()})
    write_json(truth / "seed.json", {"seed": seed})
    with atomic(truth / "corners.npz") as temporary:
        np.savez_compressed(
            temporary,
            frames_px=frames_px,
            frames_visible=frames_visible,
            base_px=base_px,
            base_visible=base_visible,
        )
    return _recorded(out, dataset, *(f"truth/{n}" for n in ("layout.json", "poses.json", "seed.json", "corners.npz")))
