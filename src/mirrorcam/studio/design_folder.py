"""The folder of one design that a page made: its files, all of them together, and nothing beside it."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from mirrorcam.core.disk.files import write_text
from mirrorcam.core.disk.zip_files import files_to_zip, write_zip
from mirrorcam.core.values import InputError
from mirrorcam.designs.design_files import DESIGN_FILE, request_toml
from mirrorcam.optics.geometry.layout import Layout

NAME = re.compile(r"[\w.-]{1,100}")


def folder_name(layout: Layout) -> str:
    """The name of a design's folder: the same design has the same one."""
    return f"{layout.arrangement.text.replace(' ', '')}-{layout.identity[:8]}"


def write_folder(root: Path, layout: Layout) -> str:
    """Write layout.json and design.toml of a design below `root`, unless they are there; returns the folder's name."""
    name = folder_name(layout)
    folder = root / name
    if layout.spec is None:
        raise ValueError("a layout without a spec, expected one that was designed")
    if not (folder / "layout.json").is_file():
        layout.save(folder / "layout.json")
    if not (folder / DESIGN_FILE).is_file():
        write_text(folder / DESIGN_FILE, request_toml(layout.spec))
    return name


def zipped(root: Path, name: str) -> Path:
    """A ZIP file of a folder below `root`, in the system's folder for temporary files.

    The same files give the same bytes. Raises InputError for a folder that is not there or leads out of `root`.
    """
    parts = name.split("/")
    folder = root.joinpath(*parts)
    if not all(NAME.fullmatch(part) and part not in (".", "..") for part in parts) or not folder.is_dir():
        raise InputError(f"{name[:100]}: no such folder")
    files = files_to_zip(folder)
    with tempfile.NamedTemporaryFile(suffix=".zip", delete=False) as file:
        path = Path(file.name)
    try:
        write_zip(path, {f"{parts[0]}/{inside}": place for inside, place in files.items()})
    except BaseException:
        path.unlink()
        raise
    return path
