"""Requests for designs as files: `design.toml`, or the layout that one led to."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, keys_of, model_from, model_of, read_bytes, tables_of
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

DESIGN_FILE = "design.toml"


def read_request(path: Path) -> DesignSpec:
    """The request in a TOML or JSON file, or of the layout in it; its camera may be a file, too.

    Raises InputError in one line.
    """
    raw = read_bytes(path, LARGEST_LAYOUT_BYTES)
    _require_suffix(path)
    tables = tables_of(path, raw)
    if not isinstance(tables, dict) or not isinstance(tables.get("camera"), str):
        return request_of(path, raw)
    try:
        camera = read_camera(tables.pop("camera"))
    except InputError as error:
        raise InputError(f"{path}: camera: {error}") from None
    return model_from(DesignSpec, path, tables).replaced(camera=camera)


def request_of(path: Path, raw: bytes) -> DesignSpec:
    """The request in the content of a file, or of the layout in it; no file is read, and none that it names."""
    _require_suffix(path)
    if "mirrors" not in keys_of(path, raw):
        return model_of(DesignSpec, path, raw)
    layout = model_of(Layout, path, raw)
    if layout.spec is None:
        raise InputError(f"{path}: a layout without its request, expected one that `mirrorcam design` wrote")
    return layout.spec


def _require_suffix(path: Path) -> None:
    if path.suffix.lower() not in (".toml", ".json"):
        raise InputError(f"{path}: expected a design.toml or a layout.json")


def request_toml(spec: DesignSpec) -> str:
    """The content of `design.toml`."""
    import tomli_w

    return tomli_w.dumps(spec.model_dump(mode="json"))
