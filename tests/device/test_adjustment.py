"""Turns from a calibration: known misalignments come back, with their uncertainty, and what is out of reach is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.holder.carriers import rotation_about, virtual_centre_after
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.licence import write_source
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.device.adjustment import FILES, adjust, read_device, turns_figure, write_adjustment
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.mirror import Mirror
from tests.cad.holder.screwed import pair, planned, with_screws
from tests.cad.parabolas import parabola


def with_centre(mirror: Mirror, centre: FloatArray) -> Mirror:
    """A mirror with another virtual centre, its outline as the camera sees it."""
    outline = mirror.outline_in_rig_mm
    moved = outline * (0.5 * (centre @ centre) / (outline @ centre))[:, None]
    return mirror.replaced(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=moved)


def misaligned(tilt_deg: float = 0.5, sigma_mm: float | None = None) -> Layout:
    """The pair, each mirror tilted about an axis of its own and a little off."""
    layout, rng = pair(), np.random.default_rng(3)
    mirrors = []
    for mirror in layout.mirrors:
        axis = rng.normal(size=3)
        turned = rotation_about(axis / np.linalg.norm(axis), np.radians(tilt_deg))
        mirrors.append(with_centre(mirror, 1.002 * turned @ mirror.virtual_centre_in_rig_mm))
    names = tuple(f"mirror {index} {axis}_mm" for index in range(len(mirrors)) for axis in "xyz")
    known = None
    if sigma_mm is not None:
        known = Uncertainty(parameters=names, covariance=sigma_mm**2 * np.eye(len(names)))
    return layout.replaced(mirrors=tuple(mirrors), kind="calibrated", uncertainty=known)


def test_the_computed_turns_bring_every_mirror_to_its_design() -> None:
    measured, designed = misaligned(), pair()
    found = adjust(measured, designed, with_screws())
    for each, was, wanted, carrier in zip(
        found.mirrors, measured.mirrors, designed.mirrors, planned().carriers, strict=True
    ):
        assert each.tilt_deg > 0.2
        assert np.abs(each.turns).max() > 0.05
        moved = virtual_centre_after(was.virtual_centre_in_rig_mm, carrier, each.turns)
        assert np.abs(moved - wanted.virtual_centre_in_rig_mm).max() < 1e-9
        assert each.reached
        assert np.isnan(each.sigma_turns).all()


@pytest.mark.slow
def test_the_uncertainty_of_turns_follows_from_that_of_the_calibration() -> None:
    """Turns of mirrors drawn from the covariance scatter as stated."""
    rng, sigma = np.random.default_rng(0), 0.01
    measured = misaligned(sigma_mm=sigma)
    stated = adjust(measured, pair(), with_screws()).mirrors[0].sigma_turns
    drawn = []
    for _ in range(40):
        noisy = with_centre(
            measured.mirrors[0], measured.mirrors[0].virtual_centre_in_rig_mm + sigma * rng.normal(size=3)
        )
        moved = measured.replaced(mirrors=(noisy, *measured.mirrors[1:]))
        drawn.append(adjust(moved, pair(), with_screws()).mirrors[0].turns)
    assert np.std(drawn, axis=0) == pytest.approx(stated, rel=0.4)


def test_a_mirror_beyond_the_travel_is_named_and_glued_ones_are_refused() -> None:
    assert not adjust(misaligned(tilt_deg=4.0), pair(), with_screws()).mirrors[0].reached
    with pytest.raises(InputError, match=r'fixed to their holder, expected holder\.mirrors = "screws"'):
        adjust(misaligned(), pair(), HARDWARE)
    with pytest.raises(InputError, match="calibration has 2 mirrors, expected the 4 of the device"):
        adjust(misaligned(), parabola(2, 2, scale_mm=60.0), with_screws())


def test_a_devices_folder_gives_what_it_was_made_from(tmp_path: Path) -> None:
    write_source(tmp_path, pair(), with_screws("nut"))
    layout, hardware = read_device(tmp_path)
    assert layout.identity == pair().identity
    assert hardware.holder.mirrors == "screws"
    assert hardware.screw.kind == "nut"
    with pytest.raises(InputError, match=r"has no source/layout\.json"):
        read_device(tmp_path / "source")


def test_files_say_the_same_and_screws_are_as_seen_from_behind(tmp_path: Path) -> None:
    found = adjust(misaligned(sigma_mm=0.01), pair(), with_screws())
    write_adjustment(found, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    rows = json.loads((tmp_path / "turns.json").read_text(encoding="utf-8"))
    assert [row["mirror"] for row in rows] == ["0-0", "0-1"]
    assert rows[0]["turns"] == pytest.approx(found.mirrors[0].turns, abs=1e-3)
    # Behind the device column 0 is at the left.
    left, right = (np.mean(row["screws_mm"], axis=0)[0] for row in rows)
    assert left < right


def test_the_picture_is_drawn_alike_each_time_and_shows_the_turns(tmp_path: Path) -> None:
    found = adjust(misaligned(), pair(), with_screws())
    other = replace(found, mirrors=tuple(replace(mirror, turns=-mirror.turns) for mirror in found.mirrors))
    for name, each in {"a": found, "b": found, "c": other}.items():
        turns_figure(each, tmp_path / f"{name}.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (read_image(tmp_path / "a.png") != read_image(tmp_path / "c.png")).any()
