"""The folder of a design: written once, zipped whole, and nothing of what lies beside it."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.designs.design_files import read_request
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.design_folder import folder_name, write_folder, zipped


def test_a_design_has_one_folder_and_files_in_it_stay(default_layout: Layout, tmp_path: Path) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    name = write_folder(tmp_path, layout)
    assert name == folder_name(layout) == f"3x3-{layout.identity[:8]}"
    assert read_request(tmp_path / name / "design.toml").spec == DesignSpec()
    (tmp_path / name / "layout.json").write_text("changed by the user")
    assert write_folder(tmp_path, layout) == name
    assert (tmp_path / name / "layout.json").read_text() == "changed by the user"


def test_a_zip_holds_all_files_but_hidden_ones_and_has_the_same_bytes_again(tmp_path: Path) -> None:
    folder = tmp_path / "d" / "parts"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "a.txt").write_text("a")
    (folder / ".mirrorcam").mkdir()
    (folder / ".mirrorcam" / "written.jsonl").write_text("{}")
    first, second = (zipped(tmp_path, "d/parts") for _ in range(2))
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        assert archive.namelist() == ["d/inner/a.txt"]
    first.unlink()
    second.unlink()


@pytest.mark.parametrize("name", ["", "..", "d/..", "../x", "d//parts", "none", "d/parts/inner/a.txt", "d/link"])
def test_no_other_folder_is_zipped(name: str, tmp_path: Path) -> None:
    root = tmp_path / "root"
    (root / "d" / "parts" / "inner").mkdir(parents=True)
    (root / "d" / "parts" / "inner" / "a.txt").touch()
    (root / "d" / "link").symlink_to(tmp_path)
    with pytest.raises(InputError):
        zipped(root, name)
