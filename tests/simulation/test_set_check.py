"""A set passes its check only where every file is there and as it was rendered."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.values import InputError
from mirrorcam.simulation.set_check import SetCheck, check_set
from tests.render_scenes.manifests import dataset_of_two_frames


@pytest.mark.parametrize(
    ("altered", "lost", "unfinished", "passed"),
    [((), (), (), True), (("a",), (), (), False), ((), ("a",), (), False), ((), (), ("a",), False)],
)
def test_any_file_that_is_not_right_fails_the_check(
    altered: tuple[str, ...], lost: tuple[str, ...], unfinished: tuple[str, ...], passed: bool
) -> None:
    assert SetCheck(3, altered, lost, unfinished).passed == passed


@pytest.mark.parametrize("name", ["../secret", "/secret", "link/secret"])
def test_no_file_outside_of_the_set_is_read(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    (tmp_path / "secret").write_text("theirs")
    (folder / "link").symlink_to(tmp_path)
    name = str(tmp_path / "secret") if name == "/secret" else name
    dataset_of_two_frames().replaced(files={name: file_digest(tmp_path / "secret")}).save(folder)
    with pytest.raises(InputError, match=r"set: lists .*, expected the name of a file in this folder"):
        check_set(folder)
