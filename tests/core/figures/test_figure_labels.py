"""Labels of figures: one for each check that a layout, a device or a validation has, and plain words."""

from __future__ import annotations

import pytest

from mirrorcam.core.figures import figure_labels
from mirrorcam.core.figures.figure_labels import ASSEMBLY, DESIGNS, LABELS, LIGHT, MIRRORS
from mirrorcam.core.figures.figure_texts import UNIT_ENDINGS, label_text
from mirrorcam.optics.geometry.layout import Layout


def test_every_check_of_a_design_has_a_label(default_layout: Layout) -> None:
    names = {name.rpartition("_")[0] if name.startswith("common_area_") else name for name in default_layout.verdict}
    assert len(names) > 5
    assert names - set(LABELS) == set()


def test_no_name_is_in_two_parts_of_the_table() -> None:
    parts = [value for name, value in vars(figure_labels).items() if name.isupper() and value is not LABELS]
    assert sum(map(len, parts)) == len(LABELS)


@pytest.mark.parametrize("name", LABELS)
def test_labels_are_words_without_the_unit_and_differ(name: str) -> None:
    assert "_" not in LABELS[name]
    assert LABELS[name].split()[-1] not in UNIT_ENDINGS
    assert [other for other, label in LABELS.items() if label == LABELS[name]] == [name]
    assert label_text(f"mount.{name}") == f"mount: {LABELS[name]}"


def test_labels_of_a_design_fit_a_terminal_of_80_columns() -> None:
    assert [label for label in DESIGNS.values() if len(label) > 27] == []


def test_labels_of_a_device_fit_a_terminal_of_80_columns() -> None:
    long = [label for part in (ASSEMBLY, LIGHT, MIRRORS) for label in part.values() if len(f"mirrors: {label}") > 40]
    assert long == [
        "tilt of the mirrors under gravity",
        "shift of the mirrors under gravity",
    ]  # of the mount: not printed
