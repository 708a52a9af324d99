"""Files without damage are used, so that a refusal of a damaged one is due to the damage."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.robustness.files import KINDS, Kind


@pytest.mark.parametrize("kind", [each for some in KINDS.values() for each in some], ids=lambda kind: kind.name)
def test_files_without_damage_are_used(kind: Kind, tmp_path: Path) -> None:
    path = tmp_path / kind.name
    path.write_text(kind.text(), encoding="utf-8")
    kind.use(path)
