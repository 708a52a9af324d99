"""Labelled points of a camera that sees them directly and in mirrors, and the sheets of files that hold them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray

DIRECT_NAME = "direct"
MIN_LIKELIHOOD = 0.6
"""Labels that a tracker itself trusts less are left out, as DeepLabCut does by default."""
MAX_LISTED = 5


@dataclass(frozen=True, eq=False)
class LabelTable:
    """Labelled points, one row for each label, view and frame.

    Attributes
    ----------
    frames, labels
        Names of frames and of labels.
    views
        Names of the views: the direct one, then the mirrors.
    frame, label
        Indices (n,) into `frames` and `labels`.
    view
        Mirror of each row (n,), or DIRECT.
    pixels
        Positions (n, 2) in the frame as the camera gives it, not flipped or cropped; pixel (0, 0) is the centre of the
        top-left pixel.
    notes
        What was left out, a sentence each.
    """

    frames: tuple[str, ...]
    labels: tuple[str, ...]
    views: tuple[str, ...]
    frame: IntArray
    view: IntArray
    label: IntArray
    pixels: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        rows = len(self.frame)
        for column in fields(self):
            if column.name in ("view", "label", "pixels"):
                expected = (rows, 2) if column.name == "pixels" else (rows,)
                if getattr(self, column.name).shape != expected:
                    shape = getattr(self, column.name).shape
                    raise ValueError(f"{column.name} has shape {shape}, expected {expected}")
        if not np.isfinite(self.pixels).all():
            raise ValueError("pixels hold a value that is NaN or infinite, expected finite numbers")
        if len(self.views) < 2:
            raise InputError("labels of one view, expected a direct view and one or more mirrors")


@dataclass(frozen=True, eq=False)
class Sheet:
    """Labels of one file, before views are told apart.

    Attributes
    ----------
    name
        Name of the file, for messages.
    frames
        Name of each row (f).
    columns
        View and label of each column (c); the view is None where the file does not state it.
    pixels
        Positions (f, c, 2); NaN without a label.
    likelihood
        The tracker's confidence (f, c); NaN where it states none.
    """

    name: str
    frames: tuple[str, ...]
    columns: tuple[tuple[str | None, str], ...]
    pixels: FloatArray
    likelihood: FloatArray


def label_table(sheets: Sequence[Sheet], views: Sequence[str] = ()) -> LabelTable:
    """Join the sheets of files.

    Views are told apart by a column of the files; else by the names of labels, which begin or end with one of `views`
    ("paw_side"); else each file is one view, in the order of `views`, or named by the files.

    Parameters
    ----------
    sheets
        Labels of each file.
    views
        Names of the views, the direct one first.

    Raises
    ------
    InputError
        If views cannot be told apart, or a label occurs twice.
    """
    if all(view is not None for sheet in sheets for view, _ in sheet.columns):
        names = list(views) or _stated_views(sheets)
        return _joined(sheets, names, [sheet.frames for sheet in sheets])
    named = [_by_name(sheet, views) for sheet in sheets]
    if any(view is not None for sheet in named for view, _ in sheet.columns):
        # Each file is a recording, whose frames may be numbered as those of another.
        prefixes = [f"{sheet.name} " if len(sheets) > 1 else "" for sheet in named]
        frames = [
            tuple(prefix + frame for frame in sheet.frames) for prefix, sheet in zip(prefixes, named, strict=True)
        ]
        return _joined(named, list(views), frames)
    if len(sheets) < 2 or (views and len(views) != len(sheets)):
        raise InputError(
            f"{sheets[0].name}: nothing tells its views apart: give --views with the direct view first, whose names "
            "the labels begin or end with (paw_side), or one file for each view"
        )
    names = list(views) or [sheet.name.rsplit(".", 1)[0] for sheet in sheets]
    if len(set(names)) < len(names):
        raise InputError(f"views share a name, expected distinct names of views or files: {', '.join(names)}")
    by_file = [
        Sheet(
            sheet.name,
            sheet.frames,
            tuple((name, label) for _, label in sheet.columns),
            sheet.pixels,
            sheet.likelihood,
        )
        for name, sheet in zip(names, sheets, strict=True)
    ]
    # Folders of labelled pictures are named by the view.
    return _joined(by_file, names, [tuple(frame.rsplit("/", 1)[-1] for frame in sheet.frames) for sheet in sheets])


def _stated_views(sheets: Sequence[Sheet]) -> list[str]:
    names = dict.fromkeys(view for sheet in sheets for view, _ in sheet.columns if view is not None)
    if DIRECT_NAME not in names:
        raise InputError(
            f"{sheets[0].name}: no view is called {DIRECT_NAME!r}: give --views with the direct view first, of "
            f"{', '.join(names)}"
        )
    return [DIRECT_NAME, *(name for name in names if name != DIRECT_NAME)]


def _by_name(sheet: Sheet, views: Sequence[str]) -> Sheet:
    """Split the names of labels into view and label."""

    def split(name: str) -> tuple[str | None, str]:
        for view in sorted(views, key=len, reverse=True):
            quoted = re.escape(view)
            match = re.fullmatch(f"(.+)[-_. ]{quoted}|{quoted}[-_. ](.+)", name)
            if match:
                return view, match[1] or match[2]
        return None, name

    columns = tuple(split(label) for _, label in sheet.columns)
    return Sheet(sheet.name, sheet.frames, columns, sheet.pixels, sheet.likelihood)


def _joined(sheets: Sequence[Sheet], views: list[str], frames: Sequence[tuple[str, ...]]) -> LabelTable:
    frame_numbers: dict[str, int] = {}
    label_numbers: dict[str, int] = {}
    without_view = sorted({label for sheet in sheets for view, label in sheet.columns if view not in views})
    parts, distrusted = [], 0
    for sheet, names in zip(sheets, frames, strict=True):
        rows = np.array([frame_numbers.setdefault(name, len(frame_numbers)) for name in names], dtype=np.int64)
        columns = [number for number, (view, _) in enumerate(sheet.columns) if view in views]
        view = np.array([views.index(str(sheet.columns[number][0])) for number in columns], dtype=np.int64) + DIRECT
        label = np.array(
            [label_numbers.setdefault(sheet.columns[number][1], len(label_numbers)) for number in columns],
            dtype=np.int64,
        )
        pixels, likelihood = sheet.pixels[:, columns], sheet.likelihood[:, columns]
        labelled = np.isfinite(pixels).all(axis=2)
        trusted = ~(likelihood < MIN_LIKELIHOOD)
        distrusted += int((labelled & ~trusted).sum())
        f, c = np.nonzero(labelled & trusted)
        parts.append((rows[f], view[c], label[c], pixels[f, c]))
    frame, view, label, positions = (np.concatenate(column) for column in zip(*parts, strict=True))
    names, labels = tuple(frame_numbers), tuple(label_numbers)
    keys = np.stack([frame, view, label], axis=1)
    unique, first, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        f, v, k = unique[int(np.argmax(counts > 1))].tolist()
        raise InputError(
            f"label {labels[k]!r} of view {views[v - DIRECT]!r} occurs twice in frame {names[f]!r}, expected once"
        )
    notes = []
    if without_view:
        listed = ", ".join(without_view[:MAX_LISTED]) + (" ..." if len(without_view) > MAX_LISTED else "")
        notes.append(f"{len(without_view)} labels belong to no view and are not used: {shortened(listed, 200)}")
    if distrusted:
        notes.append(f"{distrusted} labels have a likelihood below {MIN_LIKELIHOOD} and are not used")
    return LabelTable(
        names, labels, tuple(views), frame[first], view[first], label[first], positions[first], tuple(notes)
    )
