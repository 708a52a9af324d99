"""ZIP files: the same bytes of the same contents, whatever the dates, rights and order; no way out of a folder."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest

from mirrorcam.core.disk.zip_files import files_to_zip, write_zip
from mirrorcam.core.errors import InputError


def folder(root: Path, *, date_s: int, mode: int) -> Path:
    for name, text in (("b.txt", "second"), ("a/c.txt", "first"), (".hidden/d", "no"), ("a/.e", "no")):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(mode)
        os.utime(path, (date_s, date_s))
    return root


def test_the_same_contents_give_the_same_bytes(tmp_path: Path) -> None:
    written = []
    for number, (date_s, mode) in enumerate(((1_000_000_000, 0o600), (1_700_000_000, 0o755))):
        files: dict[str, Path | bytes] = {**files_to_zip(folder(tmp_path / str(number), date_s=date_s, mode=mode))}
        extra: dict[str, Path | bytes] = {"README.txt": b"read me"}
        path = tmp_path / f"{number}.zip"
        write_zip(path, files | extra if number else extra | files)
        written.append(path.read_bytes())
    assert written[0] == written[1]
    write_zip(tmp_path / "other.zip", {"README.txt": b"read me!"})
    assert (tmp_path / "other.zip").read_bytes() != written[0]


def test_what_is_packed_comes_out_as_it_was(tmp_path: Path) -> None:
    place = folder(tmp_path / "in", date_s=1_000_000_000, mode=0o644)
    write_zip(tmp_path / "x.zip", {**files_to_zip(place), "README.txt": b"read me"})
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["README.txt", "a/c.txt", "b.txt"]
        archive.extractall(tmp_path / "out")
    assert (tmp_path / "out" / "a" / "c.txt").read_text() == "first"
    assert os.access(tmp_path / "out" / "b.txt", os.R_OK)


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "C:\\x"])
def test_a_name_that_leads_out_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="expected the name of a file"):
        write_zip(tmp_path / "x.zip", {name: b""})
    assert list(tmp_path.iterdir()) == []


def test_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "link").symlink_to("/etc/hostname")
    with pytest.raises(InputError, match="link: is a link"):
        files_to_zip(tmp_path / "in")
