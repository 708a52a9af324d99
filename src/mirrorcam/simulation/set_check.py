"""Check of the files of a rendered set against their checksums."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirrorcam.render_scenes.sets.dataset import Dataset


@dataclass(frozen=True)
class SetCheck:
    """Files of a set against their checksums: those that differ or have gone, and those not rendered yet."""

    files: int
    altered: tuple[str, ...]
    lost: tuple[str, ...]
    unfinished: tuple[str, ...]

    @property
    def passed(self) -> bool:
        return not (self.altered or self.lost or self.unfinished)


def check_set(folder: Path) -> SetCheck:
    """Compare every file of a rendered set with its checksum."""
    dataset = Dataset.load(folder)
    wrong = [name for name in dataset.files if not dataset.intact(folder, name)]
    return SetCheck(
        files=len(dataset.files),
        altered=tuple(name for name in wrong if (folder / name).exists()),
        lost=tuple(name for name in wrong if not (folder / name).exists()),
        unfinished=tuple(dataset.missing),
    )
