"""Files of the ground truth: as many as there is something to tell, and read back as they were."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco
from mirrorcam.render_scenes.mirror_finish import uniform_finishes
from mirrorcam.render_scenes.sets.dataset import TRUTH
from mirrorcam.render_scenes.sets.poses import plan_base_frames, plan_frames
from mirrorcam.render_scenes.sets.set_truth import write_truth
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.truth.corners import Oracle


def test_the_truth_is_read_back_as_it_was(small_layout: Layout, small_board: Charuco, tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    base = plan_base_frames(small_layout, small_board, 1, random)
    moments = plan_frames(small_layout, small_board, 2, random).poses[:, None]
    oracle = Oracle(small_layout, small_board)
    write_truth(tmp_path / "still", oracle, (), moments, base, 7)
    finishes = uniform_finishes(RenderSettings(), 9)
    write_truth(tmp_path / "moving", oracle, finishes, np.repeat(moments, 3, axis=1), base, 7)
    for folder, names in (("still", TRUTH[:-2]), ("moving", TRUTH)):
        files = {path.relative_to(tmp_path / folder).as_posix() for path in (tmp_path / folder).rglob("*.*")}
        assert files == set(names)
    truth = tmp_path / "still" / "truth"
    poses = json.loads((truth / "poses.json").read_text(encoding="utf-8"))
    np.testing.assert_array_equal(poses["frames"], moments[:, 0])
    np.testing.assert_array_equal(poses["base"], base.poses)
    corners = np.load(truth / "corners.npz")
    np.testing.assert_array_equal(corners["frames_px"][1], oracle.by_mirrors(moments[1, 0])[0])
    assert Layout.load(truth / "layout.json") == small_layout
