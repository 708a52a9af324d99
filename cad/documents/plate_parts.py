"""Which parts a print plate holds."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path


def part_numbers(path: Path) -> list[str]:
    """The numbers of the parts in a 3MF file as `cad.write.threemf` writes it, in their order there."""
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode("utf-8")
    return re.findall(r'<object [^>]*partnumber="([^"]*)"', model)
