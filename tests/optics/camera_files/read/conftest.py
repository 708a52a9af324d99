"""The exports of a device, to be read back and scored."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.optics.camera_files.write import write_exports
from tests.optics.camera_files.rigs import device


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true device in the formats of other tools."""
    folder = tmp_path_factory.mktemp("exported")
    write_exports(device().truth, folder)
    return folder
