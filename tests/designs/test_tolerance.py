"""What `mirrorcam design --tolerance` writes, draws and prints."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam import cli
from mirrorcam.core.console.progress import console
from mirrorcam.core.figures.figure_texts import equal_decimals
from mirrorcam.core.images.pictures import read_image
from mirrorcam.designs.design_command import print_tolerance
from mirrorcam.designs.tolerance import COLOURS, tolerance_figure, tolerance_metrics, write_tolerance
from mirrorcam.optics.design.assess.monte_carlo import Study, study
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.run.run_page import read_metrics

FILES = ("tolerance.json", "tolerance.png")


@pytest.fixture(scope="module")
def pair() -> Layout:
    return design(DesignSpec(rows=1, cols=2))


def test_figures_form_a_flat_table_with_units(found: Study) -> None:
    metrics = tolerance_metrics(found)
    assert (metrics["tolerance.tilt_deg"].value, metrics["tolerance.tilt_deg"].unit) == (0.3, "deg")
    assert (metrics["tolerance.camera_offset_mm"].value, metrics["tolerance.camera_offset_mm"].unit) == (0.5, "mm")
    assert metrics["devices"].value == 20
    spread = found.spreads[1.0]["grid_error"]
    values = [metrics[f"grid_error.{end}"].value for end in ("design", "p5", "median", "p95")]
    assert values == [spread.nominal, spread.low, spread.median, spread.high]
    assert metrics["grid_error.median"].unit == "grid spacings"
    coarse = metrics["at_2x.pixel_efficiency_300mm.p5"]
    assert (coarse.value, coarse.unit) == (found.spreads[2.0]["pixel_efficiency_300mm"].low, "of the sensor")
    assert metrics["share.mirror_tilt.misregistration_500mm"].value > 0.5
    assert metrics["at_2x.hidden_mirrors"].value == found.hidden[2.0]
    names = len(found.spreads[1.0])
    assert len(metrics) == 5 + 1 + 4 * (4 * names + 1) + 5 * names


def test_tables_show_every_figure(found: Study, capsys: pytest.CaptureFixture[str]) -> None:
    console.cache_clear()
    print_tolerance(found)
    printed = capsys.readouterr().out
    console.cache_clear()
    for words in ("mirrors tilted 0.3° and shifted 0.3 mm", "p95", "0.25x", "mirror", "hidden mirrors"):
        assert words in printed
    for spread in found.spreads[1.0].values():
        for text in equal_decimals([spread.nominal, spread.low, spread.median, spread.high]):
            assert text in printed


@pytest.mark.slow
def test_the_same_layout_gives_the_same_bytes(pair: Layout, tmp_path: Path) -> None:
    studies = [write_tolerance(pair, Tolerances.hobby(), tmp_path / name) for name in ("one", "two")]
    assert studies[0] == studies[1]
    for name in FILES:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == [*FILES]
    assert read_metrics(tmp_path / "one" / "tolerance.json") == tolerance_metrics(studies[0])


@pytest.fixture
def command(
    monkeypatch: pytest.MonkeyPatch, pair: Layout, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> Callable[[str], tuple[int, str, str]]:
    """`mirrorcam design`, with a layout at hand for what the optimiser would find; exit code, output, errors."""
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls, progress: pair)
    monkeypatch.chdir(tmp_path)

    def run(arguments: str) -> tuple[int, str, str]:
        console.cache_clear()
        code = cli.main(["design", "--rows", "1", "--cols", "2", "--out", "out", *arguments.split()])
        console.cache_clear()
        return code, *capfd.readouterr()

    return run


@pytest.mark.slow
def test_the_option_alone_describes_a_hobby_printer(
    command: Callable[[str], tuple[int, str, str]], tmp_path: Path
) -> None:
    code, output, errors = command("--tolerance")
    assert (code, errors) == (0, "")
    metrics = json.loads((tmp_path / "out" / "tolerance.json").read_text())
    for name, value in Tolerances.hobby().model_dump(include={"tilt_deg", "offset_mm", "camera_turn_deg"}).items():
        assert metrics[f"tolerance.{name}"]["value"] == value
    assert metrics["devices"]["value"] == 200
    assert "tolerance.json and out/tolerance.png written" in output
    # A layout that nothing is said about takes what was said of the former with it.
    assert command("")[0] == 0
    assert not any((tmp_path / "out" / name).exists() for name in FILES)


@pytest.mark.slow
def test_tolerances_can_be_given(command: Callable[[str], tuple[int, str, str]], tmp_path: Path) -> None:
    (tmp_path / "design.toml").write_text("[tolerances]\ntilt_deg = 0.1\nsheet_thickness_mm = 0\ncentre_px = 8\n")
    code, output, _ = command("design.toml --tolerance")
    assert code == 0
    metrics = json.loads((tmp_path / "out" / "tolerance.json").read_text())
    stated = [metrics[f"tolerance.{name}"]["value"] for name in ("tilt_deg", "camera_offset_mm", "sheet_thickness_mm")]
    assert stated == [0.1, Tolerances.hobby().camera_offset_mm, 0.0]
    assert "share.sheet_thickness.grid_error" not in metrics
    assert metrics["share.camera_itself.off_sensor"]["value"] > 0.1
    assert "mirrors tilted 0.1°" in output


@pytest.mark.parametrize(
    ("stated", "complaint"),
    [
        ("tilt_deg = -1", "design.toml: tolerances.tilt_deg: Input should be greater than or equal to 0"),
        ("camera_turn_deg = nan", "design.toml: tolerances.camera_turn_deg: Input should be a finite number"),
        ("offset_mm = 'wide'", "design.toml: tolerances.offset_mm: str, expected a number"),
        ("tilt_degree = 0.5", "design.toml: tolerances.tilt_degree: not known, did you mean tilt_deg?"),
        ("sheet_thickness_mm = 0.9", "sheet_thickness_mm 0.9"),
    ],
)
def test_bad_tolerances_are_refused_in_one_line(
    command: Callable[[str], tuple[int, str, str]], stated: str, complaint: str, tmp_path: Path
) -> None:
    (tmp_path / "design.toml").write_text(f"[tolerances]\n{stated}\n")
    code, _, errors = command("design.toml --tolerance")
    assert code == 2
    assert errors.count("\n") == 1
    assert errors.startswith("mirrorcam: ")
    assert complaint in errors
    assert not any((tmp_path / "out" / name).exists() for name in FILES)


@pytest.fixture
def picture(found: Study, tmp_path: Path) -> NDArray[np.uint8]:
    tolerance_figure(found, tmp_path / "tolerance.png")
    return read_image(tmp_path / "tolerance.png")


def share_of(picture: NDArray[np.uint8], colour: str) -> float:
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return float((np.abs(picture.astype(int) - wanted).max(axis=-1) < 12).mean())


@pytest.mark.slow
def test_bars_are_as_long_as_the_shares(picture: NDArray[np.uint8], found: Study) -> None:
    """The lower part of the picture is one block of bars in the colours of the causes."""
    bars = picture[picture.shape[0] * 62 // 100 :]
    areas = np.array([share_of(bars, colour) for colour in COLOURS])
    shares = np.array([sum(of_cause.values()) for of_cause in found.cause_fractions.values()])
    np.testing.assert_allclose(areas[:5] / areas.sum(), shares / shares.sum(), atol=0.02)
    assert areas.sum() > 0.3


def test_nothing_is_cut_off_at_the_border(picture: NDArray[np.uint8]) -> None:
    height, width, _ = picture.shape
    assert 1400 < width < 2000
    assert 1200 < height < 2200
    border = np.concatenate([picture[:2].reshape(-1, 3), picture[-2:].reshape(-1, 3), picture[:, 0], picture[:, -1]])
    assert (border > 250).all()


@pytest.mark.slow
@pytest.mark.parametrize("depths_mm", [(400.0,), (300.0, 400.0, 500.0)])
def test_any_number_of_depths_and_no_cause_at_all(
    default_layout: Layout, depths_mm: tuple[float, ...], tmp_path: Path
) -> None:
    nothing = study(default_layout, Tolerances.none(), depths_mm, devices=2)
    tolerance_figure(nothing, tmp_path / "tolerance.png")
    assert share_of(read_image(tmp_path / "tolerance.png"), COLOURS[0]) > 0.001
