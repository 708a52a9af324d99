"""Light fields for the table of robustness: good ones are read, and what is wrong with an outcome is seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.robustness import light_fields
from benchmarks.robustness.hostile_light_fields import SECRET
from benchmarks.robustness.light_fields import CATEGORY, SUBJECTS, light_field, write
from mirrorcam.optics.light_field.io.formats.registry import NAMES, open_light_fields
from mirrorcam.optics.light_field.light_field import LightField


def test_every_format_that_is_read_is_a_subject() -> None:
    assert {*NAMES, "hdf5", "partial"} - {"ply"} == set(SUBJECTS)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_what_is_not_damaged_is_read(tmp_path: Path, subject: str) -> None:
    path = tmp_path / f"a{light_fields._ending(subject)}"
    write(path, subject)
    for found in open_light_fields(path).frames:
        assert light_fields._wrong_with([found], ".npz") == ""


def test_wrong_outcomes_are_seen() -> None:
    good = light_field()
    samples = good.samples.copy()
    samples[0, 0, 0, 0] += 1
    assert "not noticed" in light_fields._wrong_with([LightField.of(good, samples, good.weights)], ".png")
    assert light_fields._wrong_with([LightField.of(good, samples, good.weights)], ".npy") == ""
    samples[0, 0, 0, :24] = [*SECRET[:3]]
    assert "outside" in light_fields._wrong_with([LightField.of(good, samples, good.weights)], "")


@pytest.mark.parametrize("subject", range(len(SUBJECTS)), ids=SUBJECTS)
def test_some_damaged_light_fields_are_refused_or_read(tmp_path: Path, subject: int) -> None:
    for number in range(4):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert CATEGORY.attempt(5000 * len(SUBJECTS) + number * len(SUBJECTS) + subject, folder) == ""
