"""Hostile light fields: each is refused, and no file outside of its folder is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness.hostile_light_fields import HOSTILE, Change, plant
from benchmarks.robustness.light_fields import _suffix, valid_files
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.formats.registry import open_light_fields

CASES = [(subject, change) for subject, changes in HOSTILE.items() for change in changes]
# Content that a reader ignores is harmless: pictures next to an array, and consistent copies of a shape.
HARMLESS = {"_picture_huge": {"plenopticam"}}


@pytest.mark.parametrize(("subject", "change"), CASES, ids=[f"{name}{change.__name__}" for name, change in CASES])
def test_each_is_refused(subject: str, change: Change, tmp_path: Path) -> None:
    for name, content in valid_files(subject).items():
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / name).write_bytes(content)
    (tmp_path / "secrets").mkdir()
    plant(tmp_path / "secrets")
    path = tmp_path / "in" / f"a{_suffix(subject)}"
    change(path, tmp_path / "secrets", np.random.default_rng(2))
    if subject in HARMLESS.get(change.__name__, ()):
        assert list(open_light_fields(path).frames)
    else:
        with pytest.raises(InputError):
            list(open_light_fields(path).frames)
    assert not (tmp_path / "secrets" / "executed").exists()
