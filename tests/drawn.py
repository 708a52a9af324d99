"""Figures as they are when they are saved, for tests of what is on their axes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure


def drawn(draw: Callable[[], object], path: Path) -> Figure:
    """The one figure that `draw` saves; it must have written its file, too."""
    saved: list[Figure] = []
    save = Figure.savefig

    def remember(figure: Figure, *arguments: Any, **options: Any) -> None:
        saved.append(figure)
        save(figure, *arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", remember)
        draw()
    assert path.stat().st_size > 1000
    assert len(saved) == 1
    return saved[0]


def values_of(item: ScalarMappable) -> Any:
    """The values that an image or a scatter plot colours."""
    return item.get_array()
