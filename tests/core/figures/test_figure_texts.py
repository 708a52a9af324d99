"""Figures as people read them: short, with their unit and limit, and named in words."""

from __future__ import annotations

import pytest

from mirrorcam.core.figures.figure_texts import (
    count_text,
    equal_decimals,
    figure_text,
    fraction_of_limit,
    grouped_names,
    label_text,
    limit_text,
    number_word,
    sentence_case,
    sigma_text,
    value_text,
    values_text,
)
from mirrorcam.core.values import Metric


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *[
            (0.0, "0"),
            (0.105, "0.105"),
            (123456.7, "123457"),
            (-0.00012345, "-0.0001234"),
            (2e-7, "2.0e-7"),
            (-8.7e-5, "-0.000087"),
        ],
        *[(41, "41"), (1.2, "1.2"), (1234.5, "1234"), (0.123456, "0.1235"), (3.2e-7, "3.2e-7")],
    ],
)
def test_figures_are_short(value: float, text: str) -> None:
    assert figure_text(value) == text


@pytest.mark.parametrize(
    ("metric", "value", "limit"),
    [
        (Metric(value=0.00412, unit="deg", limit=0.02), "0.00412°", "≤ 0.02°"),
        (Metric(value=0.4, unit="mm", limit=1.2, lower_is_better=False), "0.4 mm", "≥ 1.2 mm"),
        (Metric(value=0.917, unit="of the view", limit=0.6, lower_is_better=False), "91.7%", "≥ 60.0%"),
        (Metric(value=41, unit="1"), "41", ""),
        (Metric(value=2.5, unit=""), "2.5", ""),
        (Metric(value=0.03, unit="um", limit=1.0), "0.03 \N{MICRO SIGN}m", "≤ 1 \N{MICRO SIGN}m"),
        (Metric(value=8.0, unit="mm3", limit=9.0), "8 mm³", "≤ 9 mm³"),
        (Metric(value=8.0, unit="mm2"), "8 mm²", ""),
        (Metric(value=8.0, unit="cm3"), "8 cm³", ""),
    ],
)
def test_values_and_limits_carry_their_unit(metric: Metric, value: str, limit: str) -> None:
    assert value_text(metric) == value
    assert limit_text(metric) == limit


def test_a_limit_next_to_a_column_of_units_has_no_unit() -> None:
    assert limit_text(Metric(value=1.0, unit="mm", limit=2.0), with_unit=False) == "≤ 2"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("grid_error", "grid error"),
        ("fov_x_deg", "field of view x"),
        ("narrow_area_mm2", "narrow area"),
        ("smallest_area_mm2", "area of the smallest mirror"),
        ("overlap_iou_1e+06mm", "overlap at 1e+06 mm"),
        ("common_area_300.5mm", "area in all views at 300.5 mm"),
        ("pixel_efficiency_300mm", "pixel efficiency at 300 mm"),
        ("unheard_rms_x_px", "unheard RMS x"),
        ("split_near_ratio", "near and far boards: difference / predicted"),
        ("device.stl_gap_mm", "device: STL gap"),
        ("mirror_holder.lie_error_um", "mirror holder: print orientation error"),
        ("mount.3mf_volume_error_mm3", "mount: volume error of the 3MF file"),
        ("mirrors.files_not_in_mm", "mirrors: cut files not in millimetres"),
        ("mm", "mm"),
    ],
)
def test_names_in_words(name: str, text: str) -> None:
    assert label_text(name) == text


@pytest.mark.parametrize(
    ("sigma", "text"),
    [
        *[(0.002, "0.0020"), (0.0021, "0.0021"), (0.00996, "0.010"), (0.3, "0.30"), (1.234, "1.2"), (12.34, "12")],
        *[(123.4, "123"), (0.0, "0"), (7e-6, "7.0e-6"), (3e-12, "0"), (float("inf"), "inf")],
    ],
)
def test_standard_deviations_have_two_digits(sigma: float, text: str) -> None:
    assert sigma_text(sigma) == text


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        *[((54.8, 60.86), ["54.80", "60.86"]), ((1.0, 1.0), ["1", "1"]), ((0.12938, 0.058971), ["0.1294", "0.0590"])],
        *[((0.0, 0.25), ["0.00", "0.25"]), ((0.0, 0.0), ["0", "0"]), ((float("inf"), 2.5), ["inf", "2.5"]), ((), [])],
        *[((1234.56, 35.5), ["1235", "36"]), ((1234.5, 3.5), ["1234", "3.5"]), ((-9.99999, 2.0), ["-10", "2"])],
        *[((1e-7, 2e-7), ["1.0e-7", "2.0e-7"]), ((float("nan"), 1.5), ["none", "1.5"])],
    ],
)
def test_values_of_one_row_have_equal_decimals(values: tuple[float, ...], texts: list[str]) -> None:
    assert equal_decimals(values) == texts


def test_values_of_one_unit_have_equal_decimals() -> None:
    mm = [Metric(value=54.8, unit="mm"), Metric(value=60.86, unit="mm")]
    assert values_text(mm) == ["54.80 mm", "60.86 mm"]
    assert values_text([mm[0], Metric(value=1e5, unit="mm or more")]) == ["54.8 mm", "100000 mm or more"]
    shares = [Metric(value=0.5, unit="of the view"), Metric(value=0.25, unit="of the view")]
    assert values_text(shares) == ["50.0%", "25.0%"]


def test_a_figure_that_is_none_says_why() -> None:
    none, one = Metric(value=float("nan"), unit="mm", limit=2.0, reason="no view"), Metric(value=1.25, unit="mm")
    assert (value_text(none), limit_text(none)) == ("none: no view", "≤ 2 mm")
    assert values_text([one, none]) == ["1.25 mm", "none: no view"]
    assert fraction_of_limit(none) == float("inf")


def test_a_name_given_by_hand_wins() -> None:
    assert label_text("grid_error", {"grid_error": "How even the grid is"}) == "How even the grid is"


def test_counts_and_sentences() -> None:
    assert (count_text(1, "frame"), count_text(2, "frame"), count_text(0, "frame")) == (
        "1 frame",
        "2 frames",
        "0 frames",
    )
    assert (number_word(9), number_word(20)) == ("nine", "20")
    assert (sentence_case("direct RMS x"), sentence_case("")) == ("Direct RMS x", "")


@pytest.mark.parametrize(
    "text",
    [
        *["photo_6.jpg: mirror 0-1 not found", "clip.mp4 frame 131: no board found", "a photo.jpg: damaged"],
        *["frames/0.png: damaged", "two clips.mp4 frame 7: no board found"],
    ],
)
def test_names_of_files_stay_as_they_are(text: str) -> None:
    assert sentence_case(text) == text
    assert sentence_case("the board is not as stated in board.toml: correct it")[:3] == "The"


@pytest.mark.parametrize(
    ("metric", "value", "limit"),
    [
        (Metric(value=0.0172, unit="of the corners", limit=0.0168), "1.72%", "≤ 1.68%"),
        (Metric(value=0.01004, unit="of the corners", limit=0.01), "1.004%", "≤ 1.000%"),
        (Metric(value=0.01001, unit="of the view", limit=0.0102, lower_is_better=False), "1.00%", "≥ 1.02%"),
        (Metric(value=1.500049, unit="1", limit=1.5), "1.50005", "≤ 1.5"),
    ],
)
def test_a_value_past_its_limit_reads_so(metric: Metric, value: str, limit: str) -> None:
    assert (value_text(metric), limit_text(metric)) == (value, limit)


def test_a_value_within_its_limit_needs_no_further_digits() -> None:
    assert value_text(Metric(value=0.0168, unit="of the corners", limit=0.0172)) == "1.7%"


def test_frames_of_one_video_are_named_together() -> None:
    names = ["a.jpg", "clip.mp4 frame 7", "clip.mp4 frame 9", "b.mp4 frame 3", "b.jpg"]
    assert grouped_names(names) == "a.jpg, clip.mp4 frames 7, 9, b.mp4 frame 3, b.jpg"


@pytest.mark.parametrize(
    ("metric", "share"),
    [
        (Metric(value=0.01, unit="mm", limit=0.02), 0.5),
        (Metric(value=0.03, unit="mm", limit=0.02), 1.5),
        (Metric(value=0.8, unit="1", limit=0.4, lower_is_better=False), 0.5),
        (Metric(value=0.2, unit="1", limit=0.4, lower_is_better=False), 2.0),
        (Metric(value=0.0, unit="mm", limit=0.0), 0.0),
        (Metric(value=1.0, unit="mm", limit=0.0), float("inf")),
        (Metric(value=0.0, unit="1", limit=0.4, lower_is_better=False), float("inf")),
    ],
)
def test_share_of_limit(metric: Metric, share: float) -> None:
    assert fraction_of_limit(metric) == pytest.approx(share)
    assert metric.passed == (share <= 1)


def test_without_a_limit_there_is_no_fraction() -> None:
    with pytest.raises(ValueError, match="without a limit"):
        fraction_of_limit(Metric(value=1.0, unit="mm"))
