"""Parts that a print plate's file names."""

from __future__ import annotations

import zipfile
from pathlib import Path

from mirrorcam.cad.documents.plate_parts import part_numbers


def test_numbers_are_those_of_the_objects_in_their_order(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "plate.3mf", "w") as archive:
        archive.writestr(
            "3D/3dmodel.model", '<model><object id="1" partnumber="MC-03"/><object id="2" partnumber="MC-01"/></model>'
        )
    assert part_numbers(tmp_path / "plate.3mf") == ["MC-03", "MC-01"]
