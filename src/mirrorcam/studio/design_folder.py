"""The folder of one design that a page made: its files, all of them together, and nothing beside it."""

from __future__ import annotations

import re
import tempfile
import zipfile
from pathlib import Path

from mirrorcam.optics.base.files import linked, write_text
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.workflow.design_request import DESIGN_FILE, request_toml

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
    link = folder if folder.is_symlink() else linked(folder)
    if link is not None:
        raise InputError(f"{link.name}: is a link, expected only files and folders")
    with (
        tempfile.NamedTemporaryFile(suffix=".zip", delete=False) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            if path.is_file() and not any(part.startswith(".") for part in inside.parts):
                entry = zipfile.ZipInfo(f"{parts[0]}/{inside.as_posix()}")
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, path.read_bytes())
    return Path(file.name)
