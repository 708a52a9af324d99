"""A studio for the tests of its pages."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.studio.browser import served


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """A studio's address, and the folder it writes into."""
    folder = tmp_path_factory.mktemp("studio")
    with served(folder) as address:
        yield address, folder
