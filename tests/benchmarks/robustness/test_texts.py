"""Files without damage are used, and damaged ones are texts of their language, differently for each seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness.damage import damaged_text
from benchmarks.robustness.texts import KINDS, Kind


@pytest.mark.parametrize("kind", [each for some in KINDS.values() for each in some], ids=lambda kind: kind.name)
def test_files_without_damage_are_used(kind: Kind, tmp_path: Path) -> None:
    path = tmp_path / kind.name
    path.write_text(kind.text(), encoding="utf-8")
    kind.use(path)
    found = [damaged_text(kind.text(), path.suffix, np.random.default_rng(seed)) for seed in range(20)]
    assert len(set(found)) > 15
