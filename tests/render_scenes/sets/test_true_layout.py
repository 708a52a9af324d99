"""The true layout of a set: with the bends that its mirrors were rendered with, which scores count."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.bench.score_request import Reading, ScoreRequest
from mirrorcam.bench.scoring import score
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.values import InputError
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.sets.true_layout import FINISH, TRUTH, true_layout
from tests.optics.camera_files.rigs import device


def make_set(folder: Path) -> Path:
    """What the truth of a rendered set has of its device."""
    device().nominal.save(folder / "layout.json")
    device().truth.save(folder / TRUTH)
    return folder


def test_flat_mirrors_are_as_they_are_there(tmp_path: Path) -> None:
    assert true_layout(make_set(tmp_path / "flat")) == device().truth


def test_mirrors_that_were_rendered_bent_are_the_truth(tmp_path: Path) -> None:
    folder = make_set(tmp_path / "bent")
    count = len(device().truth.mirrors)
    finishes = [MirrorFinish(reflectance=(0.9,) * 3, sag_mm=0.01 * (-1) ** k, ripple_mm=1e-5) for k in range(count)]
    write_json(folder / FINISH, {"mirrors": [each.model_dump(mode="json") for each in finishes]})
    bent = true_layout(folder)
    assert [mirror.curvature_per_m.any() for mirror in bent.mirrors] == [True] * count
    bent.save(tmp_path / "bent.json")
    device().truth.save(tmp_path / "flat.json")
    as_bent, as_flat = (
        score([folder], ScoreRequest(calibration=(tmp_path / name,)), Reading()).sets[0].figures["rms_px"].value
        for name in ("bent.json", "flat.json")
    )
    assert as_bent < 1e-9
    assert as_flat > 0.1
    write_json(folder / FINISH, {"mirrors": [finishes[0].model_dump(mode="json")]})
    with pytest.raises(InputError, match=rf"finish\.json: 1 finishes, expected {count}, one a mirror"):
        true_layout(folder)
