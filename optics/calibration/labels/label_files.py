"""Read labels from tables of DeepLabCut, SLEAP and Anipose, and from plain CSV.

Plain CSV has a line per label with the columns `frame`, `view`, `label`, `x_px`, `y_px`, and `likelihood` if it is
known. DeepLabCut's CSV and HDF5 have rows of `scorer`, `individuals` if there are several, `bodyparts` and `coords`
above. SLEAP's analysis CSV and Anipose's tables have columns like `nose.x` or `nose_x` and a line per frame.
"""

from __future__ import annotations

import csv
import io
import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.labels.label_table import LabelTable, Sheet, label_table

LONG_COLUMNS = ("frame", "view", "label")
LIKELIHOODS = ("likelihood", "score", "confidence")
FRAME_COLUMNS = ("frame", "frame_idx", "fnum")
FORMATS = (
    "expected labels of DeepLabCut (CSV, HDF5), SLEAP (analysis CSV, HDF5), columns like nose_x and nose_y, or the "
    "columns frame, view, label, x_px, y_px"
)
_WIDE = re.compile(rf"(.+)[._ ](x|y|{'|'.join(LIKELIHOODS)})")
_Columns = list[tuple[tuple[str | None, str], str]]


def read_labels(paths: Sequence[Path], views: Sequence[str] = ()) -> LabelTable:
    """Read labels from files; `views` names the views, the direct one first (see `label_table`).

    Raises InputError, with a one-line message, for a file that cannot be read.
    """
    return label_table([_read(path) for path in paths], views)


def _read(path: Path) -> Sheet:
    if path.suffix.lower() in (".h5", ".hdf5"):
        return _read_hdf5(path)
    try:
        text = read_bytes(path).decode("utf-8-sig")
        table = [row for row in csv.reader(io.StringIO(text), strict=True) if row and not row[0].startswith("#")]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a table of labels ({error}), {FORMATS}") from None
    if len(table) < 2:
        raise InputError(f"{path}: no labels, {FORMATS}")
    width = len(table[0])
    for number, row in enumerate(table):
        if len(row) != width:
            raise InputError(f"{path}: row {number + 1} has {len(row)} cells, expected {width} as in the first")
    if table[0][0] == "scorer":
        return _deeplabcut(path, table)
    heads = [name.strip() for name in table[0]]
    return _long(path, heads, table[1:]) if set(LONG_COLUMNS) <= set(heads) else _wide(path, heads, table[1:])


def _numbers(path: Path, cells: Sequence[Sequence[str]]) -> FloatArray:
    """Numbers of cells; NaN for empty ones."""
    try:
        numbers = np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in cells])
    except ValueError as error:
        raise InputError(f"{path}: {shortened(str(error), 100)}, expected a number or an empty cell") from None
    if np.isinf(numbers).any():
        raise InputError(f"{path}: a number is infinite, expected pixels")
    return numbers.reshape(len(cells), -1)


def _sheet(path: Path, frames: Sequence[str], columns: _Columns, values: FloatArray) -> Sheet:
    """Sort the values (f, c) of columns, each with its view and label, and x, y or a likelihood."""
    keys = list(dict.fromkeys(key for key, _ in columns))
    pixels, likelihood = np.full((len(frames), len(keys), 2), np.nan), np.full((len(frames), len(keys)), np.nan)
    numbers = {key: number for number, key in enumerate(keys)}
    for (key, axis), column in zip(columns, values.T, strict=True):
        if axis in "xy":
            pixels[:, numbers[key], "xy".index(axis)] = column
        elif axis in LIKELIHOODS:
            likelihood[:, numbers[key]] = column
    if not keys:
        raise InputError(f"{path}: no labels, {FORMATS}")
    return Sheet(path.name, tuple(frames), tuple(keys), pixels, likelihood)


def _deeplabcut(path: Path, table: list[list[str]]) -> Sheet:
    heads = 0
    while heads < len(table) and table[heads][0] in ("scorer", "individuals", "bodyparts", "coords"):
        heads += 1
    levels = {row[0]: row for row in table[:heads]}
    if not {"bodyparts", "coords"} <= levels.keys():
        raise InputError(f"{path}: no rows 'bodyparts' and 'coords' below 'scorer', expected DeepLabCut's table")
    # Newer tables have three columns of folder, video and picture.
    first = next((n for n, cell in enumerate(levels["coords"]) if n and cell), 1)
    columns = _deeplabcut_columns(
        [tuple(levels[name][n] for name in ("individuals", "bodyparts", "coords") if name in levels)]
        for n in range(first, len(table[0]))
    )
    frames = ["/".join(row[:first]) for row in table[heads:]]
    return _sheet(path, frames, columns, _numbers(path, [row[first:] for row in table[heads:]]))


def _deeplabcut_columns(names: Any) -> _Columns:
    """Columns of (individual, bodypart, coordinate) or (bodypart, coordinate), each in a list of one."""
    columns: _Columns = []
    for (levels,) in names:
        *individual, part, axis = levels
        label = " ".join([*(name for name in individual if name != "single"), part])
        columns.append(((None, label), axis))
    return columns


def _long(path: Path, heads: list[str], rows: list[list[str]]) -> Sheet:
    where = {name: number for number, name in enumerate(heads)}
    x, y = (where.get(f"{axis}_px", where.get(axis)) for axis in "xy")
    if x is None or y is None:
        raise InputError(f"{path}: no columns x_px and y_px, expected them besides frame, view, label")
    confidence = next((where[name] for name in LIKELIHOODS if name in where), None)
    frames: dict[str, int] = {}
    keys: dict[tuple[str | None, str], int] = {}
    f = np.array([frames.setdefault(row[where["frame"]], len(frames)) for row in rows])
    k = np.array([keys.setdefault((row[where["view"]], row[where["label"]]), len(keys)) for row in rows])
    cells, first = np.unique(np.stack([f, k]), axis=1, return_index=True)
    if cells.shape[1] < len(rows):
        row = rows[int(np.setdiff1d(np.arange(len(rows)), first)[0])]
        named = ", ".join(f"{name} {row[where[name]]!r}" for name in LONG_COLUMNS)
        raise InputError(f"{path}: {named} occurs twice, expected once")
    pixels, likelihood = np.full((len(frames), len(keys), 2), np.nan), np.full((len(frames), len(keys)), np.nan)
    pixels[f, k] = _numbers(path, [(row[x], row[y]) for row in rows])
    if confidence is not None:
        likelihood[f, k] = _numbers(path, [(row[confidence],) for row in rows])[:, 0]
    return Sheet(path.name, tuple(frames), tuple(keys), pixels, likelihood)


def _wide(path: Path, heads: list[str], rows: list[list[str]]) -> Sheet:
    found = [(n, match) for n, name in enumerate(heads) if (match := _WIDE.fullmatch(name))]
    parts = {match[1] for _, match in found if match[2] == "x"} & {match[1] for _, match in found if match[2] == "y"}
    used = [(n, match) for n, match in found if match[1] in parts]
    frame = next((heads.index(name) for name in FRAME_COLUMNS if name in heads), None)
    if not used:
        raise InputError(f"{path}: columns {shortened(', '.join(heads), 80)}, {FORMATS}")
    frames = [str(n) for n in range(len(rows))] if frame is None else [row[frame] for row in rows]
    columns: _Columns = [((None, match[1]), match[2]) for _, match in used]
    values = _numbers(path, [[row[n] for n, _ in used] for row in rows])
    tracks = [row[heads.index("track")] for row in rows] if "track" in heads else [""] * len(rows)
    if len(set(tracks)) == 1:
        return _sheet(path, frames, columns, values)
    # SLEAP has a line for each frame and animal.
    unique = list(dict.fromkeys(frames))
    row_of = {name: number for number, name in enumerate(unique)}
    by_track, all_columns = [], []
    for track in dict.fromkeys(tracks):
        block = np.full((len(unique), len(columns)), np.nan)
        for number, name in enumerate(tracks):
            if name == track:
                block[row_of[frames[number]]] = values[number]
        by_track.append(block)
        all_columns += [((view, f"{track} {label}"), axis) for (view, label), axis in columns]
    return _sheet(path, unique, all_columns, np.concatenate(by_track, axis=1))


def _read_hdf5(path: Path) -> Sheet:
    try:
        with h5py.File(path) as file:
            if "tracks" in file and "node_names" in file:
                return _sleap(path, file)
            for group in file.values():
                if isinstance(group, h5py.Group) and "block0_values" in group:
                    return _pandas_fixed(path, group)
                if isinstance(group, h5py.Group) and "table" in group:
                    return _pandas_table(path, group)
    except (OSError, KeyError, ValueError, IndexError, TypeError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: not an HDF5 file of labels ({shortened(str(error), 100)}), {FORMATS}") from None
    raise InputError(f"{path}: no labels in it, {FORMATS}")


def _texts(values: Any) -> list[str]:
    return [value.decode() if isinstance(value, bytes) else str(value) for value in np.ravel(values).tolist()]


def _sleap(path: Path, file: h5py.File) -> Sheet:
    """SLEAP's analysis: tracks (tracks, 2, nodes, frames), and scores (tracks, nodes, frames)."""
    tracks, nodes = np.asarray(file["tracks"], dtype=np.float64), _texts(file["node_names"])
    count, _, _, frames = tracks.shape
    names = _texts(file["track_names"]) if "track_names" in file else []
    columns: _Columns = []
    values = []
    for track in range(count):
        animal = f"{names[track] if track < len(names) else track} " if count > 1 else ""
        for number, node in enumerate(nodes):
            columns += [((None, animal + node), "x"), ((None, animal + node), "y")]
            values += [tracks[track, 0, number], tracks[track, 1, number]]
    return _sheet(path, [str(n) for n in range(frames)], columns, np.array(values).T)


def _pandas_fixed(path: Path, group: h5py.Group) -> Sheet:
    """DeepLabCut's labelled data, as pandas writes it in its fixed format."""
    levels = _levels(group, "block0_items")
    columns = _deeplabcut_columns([tuple(names[1:])] for names in levels)
    frames = _texts(group["axis1"]) if "axis1" in group else ["/".join(names) for names in _levels(group, "axis1")]
    return _sheet(path, frames, columns, np.asarray(group["block0_values"], dtype=np.float64))


def _levels(group: h5py.Group, name: str) -> list[list[str]]:
    """Names of a multi-index, a list for each entry."""
    count = sum(f"{name}_level{level}" in group for level in range(8))
    columns = []
    for level in range(count):
        names = _texts(group[f"{name}_level{level}"])
        columns.append([names[code] for code in np.asarray(group[f"{name}_label{level}"]).tolist()])
    return [list(entry) for entry in zip(*columns, strict=True)]


class _PlainUnpickler(pickle.Unpickler):
    """Reads lists, tuples, texts and numbers only: nothing that a file could run."""

    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"holds {module}.{name}, expected names only")


def _pandas_table(path: Path, group: h5py.Group) -> Sheet:
    """DeepLabCut's predictions, as pandas writes them in its table format: the names of columns are pickled."""
    stored = group.attrs["non_index_axes"]
    raw = stored.encode("latin-1") if isinstance(stored, str) else bytes(stored)
    ((_, names),) = _PlainUnpickler(io.BytesIO(raw)).load()
    rows = group["table"][:]
    blocks = [rows[name].reshape(len(rows), -1) for name in rows.dtype.names if name.startswith("values_block")]
    columns = _deeplabcut_columns([tuple(str(part) for part in name[1:])] for name in names)
    if len(blocks) != 1:
        raise ValueError(f"{len(blocks)} blocks of values, expected one")
    return _sheet(path, _texts(rows["index"]), columns, np.asarray(blocks[0], dtype=np.float64))
