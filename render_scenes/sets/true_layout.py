"""The device that a set was rendered of, as a calibration that knew everything would find it."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model
from mirrorcam.core.values import InputError, Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.mirror_finish import MirrorFinish

TRUTH = "truth/layout.json"
FINISH = "truth/finish.json"


class _Finishes(Value):
    """The content of `truth/finish.json`."""

    mirrors: tuple[MirrorFinish, ...]


def true_layout(folder: Path) -> Layout:
    """The true layout of a set, with the bends that its mirrors were rendered with.

    Ripples are left out: no layout has them, and over a mirror they cancel out. Raises InputError for files that are
    none, or do not fit together.
    """
    layout = Layout.load(folder / TRUTH)
    if not (folder / FINISH).is_file():
        return layout
    finishes = read_model(_Finishes, folder / FINISH, LARGEST_LAYOUT_BYTES).mirrors
    if len(finishes) != len(layout.mirrors):
        raise InputError(f"{folder / FINISH}: {len(finishes)} finishes, expected {len(layout.mirrors)}, one a mirror")
    bent = tuple(finish.bent(mirror) for finish, mirror in zip(finishes, layout.mirrors, strict=True))
    return layout.replaced(mirrors=bent)
