"""Boards as anipose, caliscope and Kalibr describe them, in the words of `board.toml`.

anipose
    `config.toml` of a project (github.com/lambdaloop/anipose): the table `calibration`, lengths in mm. The size of a
    checkerboard counts inner corners, that of a ChArUco board squares.
caliscope
    `*charuco.toml` and `chessboard.toml` (github.com/mprib/caliscope), or the table `charuco` of older projects'
    `config.toml`: lengths in cm, or the page's in inches. A chessboard counts inner corners.
Kalibr
    The target's YAML (github.com/ethz-asl/kalibr), lengths in metres; a checkerboard counts inner corners.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries

MM_PER = {"cm": 10.0, "inch": 25.4}
MM_PER_M = 1000.0
MARKER_SHARE = 0.75  # side of a marker in squares, where caliscope's file states none
MAX_UNEQUAL = 1e-6  # relative difference between Kalibr's spacings of rows and columns
SPACING = Bounds(0.05, 0.8)
"""Gap between tags in sides of a tag."""


def as_own_board(values: Any) -> Any:
    """Return the fields of `board.toml` for another program's description of a board; other values as they are.

    Raises
    ------
    InputError
        If the description is incomplete, or of a board that is neither a checkerboard, a ChArUco board nor an
        AprilGrid. The message does not name the file.
    """
    if not isinstance(values, dict) or "kind" in values:
        return values
    if isinstance(calibration := values.get("calibration"), dict):
        return _of_anipose(calibration)
    if isinstance(charuco := values.get("charuco"), dict):
        return _charuco_of_caliscope(charuco)
    if "aruco_scale" in values or {"columns", "rows", "dictionary"} <= values.keys():
        return _charuco_of_caliscope(values)
    if {"columns", "rows"} <= values.keys():
        cols, rows = _count(values, "columns") + 1, _count(values, "rows") + 1
        return _checkerboard(cols, rows, 10.0 * _length(values, "square_size_cm"))
    if "markers" in values and "dictionary" in values:
        raise InputError("markers: a set of single markers, expected a ChArUco board or a chessboard")
    if any(key in values for key in ("target_type", "tagCols", "tagRows", "targetCols", "targetRows")):
        return _of_kalibr(values)
    return values


def _of_anipose(values: Mapping[str, Any]) -> dict[str, Any]:
    kind = str(values.get("board_type", "")).lower()
    if kind not in ("charuco", "checkerboard"):
        raise InputError(f"calibration.board_type is {kind[:40]!r}, expected 'charuco' or 'checkerboard'")
    size = values.get("board_size")
    if not isinstance(size, list) or len(size) != 2:
        raise InputError("calibration.board_size: expected two numbers: columns and rows")
    cols, rows = (_count({"board_size": number}, "board_size") for number in size)
    square_mm = _length(values, "board_square_side_length")
    if kind == "checkerboard":
        return _checkerboard(cols + 1, rows + 1, square_mm)
    bits, count = (
        _count({key: values.get(key, default)}, key)
        for key, default in (("board_marker_bits", 4), ("board_marker_dict_number", 50))
    )
    return {
        "kind": "charuco",
        "cols": cols,
        "rows": rows,
        "square_mm": square_mm,
        "marker_mm": _length(values, "board_marker_length"),
        "dictionary": f"DICT_{bits}X{bits}_{count}",
    }


def _charuco_of_caliscope(values: Mapping[str, Any]) -> dict[str, Any]:
    cols, rows = _count(values, "columns"), _count(values, "rows")
    if values.get("square_size_override_cm") in (None, "null", 0, False):
        unit = str(values.get("units", "inch"))
        if unit not in MM_PER:
            raise InputError(f"units is {unit[:40]!r}, expected 'cm' or 'inch'")
        square_mm = MM_PER[unit] * min(_length(values, "board_width") / cols, _length(values, "board_height") / rows)
    else:
        square_mm = MM_PER["cm"] * _length(values, "square_size_override_cm")
    share = _length(values, "aruco_scale") if "aruco_scale" in values else MARKER_SHARE
    dictionary = str(values.get("dictionary", "DICT_4X4_50"))
    name, markers = dictionaries.canonical_name(dictionary), cols * rows // 2
    if name and dictionaries.count(name) < markers <= dictionaries.count(dictionaries.family(name)):
        # caliscope takes a larger dictionary of the same family where a board needs more markers.
        dictionary = dictionaries.smallest(name, markers)
    board = {
        "kind": "charuco",
        "cols": cols,
        "rows": rows,
        "square_mm": square_mm,
        "marker_mm": share * square_mm,
        "dictionary": dictionary,
    }
    flags = {"inverted": values.get("inverted", False), "legacy": values.get("legacy_pattern", False)}
    return board | {key: value for key, value in flags.items() if value}


def _of_kalibr(values: Mapping[str, Any]) -> dict[str, Any]:
    likely = "aprilgrid" if "tagCols" in values or "tagRows" in values else "checkerboard"
    kind = values.get("target_type", likely)
    if kind == "checkerboard":
        across, down = (MM_PER_M * _length(values, key) for key in ("colSpacingMeters", "rowSpacingMeters"))
        if abs(across - down) > MAX_UNEQUAL * max(across, down):
            raise InputError(f"colSpacingMeters and rowSpacingMeters: {across:g} and {down:g} mm, expected squares")
        return _checkerboard(_count(values, "targetCols") + 1, _count(values, "targetRows") + 1, across)
    if kind != "aprilgrid":
        raise InputError(f"target_type is {str(kind)[:40]!r}, expected 'aprilgrid' or 'checkerboard'")
    tag_mm, spacing = MM_PER_M * _length(values, "tagSize"), _length(values, "tagSpacing")
    if not SPACING.min <= spacing <= SPACING.max:
        in_metres = MM_PER_M * spacing / tag_mm
        hint = f"; if that is in metres, it is {in_metres:.3g}" if SPACING.min <= in_metres <= SPACING.max else ""
        expected = f"the gap divided by tagSize, {SPACING.min:g} to {SPACING.max:g}"
        raise InputError(f"tagSpacing is {spacing:g}, expected {expected}{hint}")
    cols, rows = _count(values, "tagCols"), _count(values, "tagRows")
    return {"kind": "aprilgrid", "cols": cols, "rows": rows, "tag_mm": tag_mm, "spacing": spacing}


def _checkerboard(cols: int, rows: int, square_mm: float) -> dict[str, Any]:
    return {"kind": "checkerboard", "cols": cols, "rows": rows, "square_mm": square_mm}


def _count(values: Mapping[str, Any], key: str) -> int:
    value = values.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value < 10_000:
        raise InputError(f"{key}: {str(value)[:40]!r}, expected a whole number")
    return value


def _length(values: Mapping[str, Any], key: str) -> float:
    """A positive number; raises InputError for anything else."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < float("inf"):
        raise InputError(f"{key}: {str(value)[:40]!r}, expected a number above 0")
    return float(value)
