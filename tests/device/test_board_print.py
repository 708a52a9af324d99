"""Boards to print: read back from the files' own lines, in millimetres of the paper, as a printer would."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import shapely
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

from mirrorcam import cli
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.device.board_files import print_board
from mirrorcam.device.board_print import (
    EDGE_MM,
    FOOTER_MM,
    PAGES_MM,
    _drawable,
    board_in_page_mm,
    ink_in_board_mm,
    needed_mm,
    page_for,
    write_board,
)
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard, load_board, save_board
from mirrorcam.optics.geometry.marker_dictionaries import NAMES, modules
from tests.command_line import results
from tests.hostile_names import ACCEPTED, REFUSED
from tests.nightly import a_few

MM_PER_POINT = 25.4 / 72.0
PX_PER_MM = 20
CHARUCO = Charuco(cols=7, rows=5, square_mm=20.3, marker_mm=14.1, dictionary="DICT_5X5_100")
CHECKERS = Checkerboard(cols=8, rows=5, square_mm=17.7)
# Sizes at which OpenCV's raster is exact: a module of a marker is a whole number of pixels.
BOARDS = [
    Checkerboard(cols=5, rows=4, square_mm=7.5),
    *(
        Charuco(cols=5, rows=4, square_mm=modules(name) + 2.0, marker_mm=modules(name), dictionary=name)
        for name in NAMES
    ),
    *(
        Charuco(cols=cols, rows=rows, square_mm=8.0, marker_mm=6.0, legacy=True, first_marker=7)
        for cols, rows in ((5, 4), (4, 5), (6, 4))
    ),
    Charuco(cols=5, rows=4, square_mm=8.0, marker_mm=6.0, inverted=True),
    Checkerboard(cols=5, rows=5, square_mm=7.5, inverted=True),
]


def page_and_polygons_mm(path: Path) -> tuple[tuple[float, ...], list[FloatArray]]:
    """The size of the page, and the closed black outlines of straight lines on it (n, 2); x right, y down."""
    number = r"(-?[\d.]+)"
    if path.suffix == ".svg":
        text = path.read_text(encoding="utf-8")
        size = re.search(rf'width="{number}pt" height="{number}pt" viewBox="0 0 \1 \2"', text)
        assert size
        drawn = [d for d in re.findall(r'<path d="([^"]*)"/>', text) if not re.search("[QC]", d)]
        flip = None
    else:
        raw = path.read_bytes()
        size = re.search(rf"/MediaBox \[ 0 0 {number} {number} \]", raw.decode("latin-1"))
        assert size
        streams = [zlib.decompress(found) for found in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", raw, re.DOTALL)]
        (page,) = [stream.decode("ascii") for stream in streams if b"BT\n" in stream]
        page = re.sub(r"q\n[^\n]* cm\nBT\n.*?ET\nQ\n", "", page, flags=re.DOTALL)
        # But for words, nothing is scaled or shifted.
        assert not re.search(r"\bcm\b|BT", page)
        drawn = re.findall(r"((?:\S+ \S+ [ml]\n|h\n)+)\nf\n", page)[1:]  # but for the white page
        drawn = [re.sub(r"(\S+ \S+) m\n", r"M \1 ", d) for d in drawn]
        flip = float(size[2])
    width, height = (float(side) * MM_PER_POINT for side in size.groups())
    polygons = []
    for outline in drawn:
        for part in outline.split("M")[1:]:
            points = np.array(re.findall(rf"{number} {number}", part), dtype=np.float64)
            if flip is not None:
                points[:, 1] = flip - points[:, 1]
            polygons.append(points * MM_PER_POINT)
    return (width, height), polygons


def printed(page: tuple[float, ...], polygons: list[FloatArray]) -> NDArray[np.uint8]:
    """The page as a printer of 508 dots an inch leaves it."""
    paper = np.full([round(side * PX_PER_MM) for side in page[::-1]], 255, dtype=np.uint8)
    # From millimetres of the page to pixel centres, in 1/256 px; OpenCV fills up to half a pixel too low.
    rings = [np.rint((polygon * PX_PER_MM - 0.5) * 256).astype(np.int32) for polygon in polygons]
    cv2.fillPoly(paper, rings, 0, lineType=cv2.LINE_AA, shift=8)
    return np.asarray(cv2.resize(paper, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
@pytest.mark.parametrize("board", [CHARUCO, CHECKERS], ids=["charuco", "checkerboard"])
def test_corners_and_markers_are_found_on_the_paper_where_they_must_be(
    suffix: str, board: CalibrationBoard, tmp_path: Path
) -> None:
    size = page_for(board, "a4")
    write_board(board, tmp_path / f"board{suffix}", size, "board.toml")
    page, polygons = page_and_polygons_mm(tmp_path / f"board{suffix}")
    assert page == pytest.approx(size, abs=1e-4)
    expected = board.corners_in_board_mm[:, :2] + board_in_page_mm(board, size)
    paper = printed(page, polygons)
    if isinstance(board, Charuco):
        found, ids, _, markers = cv2.aruco.CharucoDetector(board.opencv_board).detectBoard(paper)
        assert sorted(markers.ravel()) == list(range(board.rows * board.cols // 2))
        assert ids.ravel().tolist() == list(range(len(expected)))
    else:
        seen, found = cv2.findChessboardCornersSB(paper, (board.cols - 1, board.rows - 1))
        assert seen
        found = min(found, found[::-1], key=lambda corners: corners[0].sum())
    in_mm = (found.reshape(-1, 2) + 0.5) * 2.0 / PX_PER_MM
    assert np.abs(in_mm - expected).max() < 0.03
    # By the lines themselves: every inner corner is a corner of outlines.
    points = np.concatenate(polygons)
    nearest = np.linalg.norm(points[:, None] - expected, axis=-1).min(axis=0)
    assert nearest.max() < 1e-5


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_the_ruler_is_100_mm_long_and_clear_of_the_board(suffix: str, tmp_path: Path) -> None:
    size = page_for(CHECKERS, "")
    write_board(CHECKERS, tmp_path / f"board{suffix}", size, "board.toml")
    page, polygons = page_and_polygons_mm(tmp_path / f"board{suffix}")
    lengths = [np.ptp(polygon[:, 0]) for polygon in polygons]
    assert sum(length == pytest.approx(100.0, abs=1e-5) for length in lengths) == 1
    ticks = sorted(p[:, 0].mean() for p in polygons if np.ptp(p[:, 0]) == pytest.approx(0.12, abs=1e-5))
    assert np.diff(ticks) == pytest.approx(np.ones(100), abs=1e-5)
    board = np.concatenate([polygon for polygon in polygons if np.ptp(polygon[:, 0]) == pytest.approx(17.7)])
    assert board.min() >= EDGE_MM
    ruler = polygons[int(np.argmax(np.isclose(lengths, 100.0)))]
    assert ruler[:, 1].min() >= board[:, 1].max() + EDGE_MM - 1e-6
    assert ruler[:, 1].max() <= page[1] - EDGE_MM


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_the_same_board_gives_the_same_bytes(suffix: str, tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_board(CHARUCO, tmp_path / f"{name}{suffix}", page_for(CHARUCO, "a3"), "board.toml")
    assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"two{suffix}").read_bytes()


def test_words_name_the_board_and_its_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save_board(tmp_path / "wall.toml", CHARUCO)
    assert cli.main(["board", "wall.toml", "--out", "wall.svg"]) == 0
    said = re.findall("<!-- (.*?) -->", Path("wall.svg").read_text(encoding="utf-8"))
    assert said[:3] == ["0", "50 mm", "100 mm"]
    assert said[3:] == [
        "wall.toml",
        "ChArUco, 7 x 5 squares of 20.3 mm",
        "markers of 14.1 mm, DICT_5X5_100",
        "printed at 100 %, its squares span 142.1 x 101.5 mm",
    ]
    assert results(tmp_path) == ["wall.svg", "wall.toml"]


def test_words_stay_on_the_smallest_page(tmp_path: Path) -> None:
    page = needed_mm(Charuco(cols=9, rows=12, square_mm=10.125, marker_mm=7.125))
    board = Charuco(cols=9, rows=12, square_mm=10.125, marker_mm=7.125, dictionary="DICT_4X4_1000")
    write_board(board, tmp_path / "board.svg", page, "W" * 60 + ".toml")
    text = (tmp_path / "board.svg").read_text(encoding="utf-8")
    # Where each line of words begins, and its glyphs: at most so wide that the page holds it.
    lines = re.findall(r"<!-- (.*?) -->.*?translate\(([\d.]+) .*?scale\(([\d.]+) .*?</g>", text, re.DOTALL)
    assert len(lines) == 7
    assert lines[3][0].endswith("W...")
    for words, left, _ in lines:
        width = TextPath((0.0, 0.0), words, size=7).get_extents().width
        assert float(left) + width < page[0] / MM_PER_POINT


@pytest.mark.parametrize(
    ("cols", "rows", "square_mm", "page"),
    [(8, 5, 17.7, "a4"), (5, 8, 17.7, "a4"), (9, 6, 40.0, "a3"), (9, 6, 110.0, "a0"), (20, 14, 12.0, "letter")],
)
def test_the_smallest_page_is_taken_upright_or_across(cols: int, rows: int, square_mm: float, page: str) -> None:
    board = Checkerboard(cols=cols, rows=rows, square_mm=square_mm)
    size = page_for(board, page)
    assert sorted(size) == sorted(PAGES_MM[page])
    assert np.greater_equal(size, needed_mm(board)).all()
    assert page == "letter" or page_for(board, "") == size


@pytest.mark.parametrize(
    ("board", "page", "complaint"),
    [
        (
            CHECKERS,
            "120x200",
            r"board of 141\.6 x 88\.5 mm: does not fit on 120x200, expected a page of 196 x 124\.5 mm",
        ),
        (Checkerboard(cols=9, rows=6, square_mm=400.0), "", "does not fit on a0"),
        (CHECKERS, "legal", r"page 'legal': expected a4, a3, a2, a1, a0, letter or WIDTHxHEIGHT in mm"),
        (CHECKERS, "200xinf", "expected a width and a height"),
        (CHECKERS, "nanx300", "expected a width and a height"),
        (CHECKERS, "-200x300", "expected a width and a height"),
        (CHECKERS, "200x300x400", "WIDTHxHEIGHT"),
    ],
)
def test_a_page_that_does_not_fit_is_refused(board: Checkerboard, page: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        page_for(board, page)


def test_a_page_of_the_stated_minimum_size_fits() -> None:
    assert page_for(CHECKERS, "196x124.5") == (196.0, 124.5)
    assert board_in_page_mm(CHECKERS, (196.0, 124.5))[1] == EDGE_MM
    assert 124.5 - EDGE_MM - FOOTER_MM - EDGE_MM - 88.5 == EDGE_MM


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("suffix", [".svg", ".pdf"])
@pytest.mark.parametrize("name", a_few(3, [r"board $\frac$ <b>.toml", *ACCEPTED, *REFUSED]))
def test_any_name_of_a_file_is_text(name: str, suffix: str, tmp_path: Path) -> None:
    board = Checkerboard(cols=8, rows=6, square_mm=20.0)
    write_board(board, tmp_path / f"board{suffix}", page_for(board, ""), name)
    if suffix == ".svg":
        texts = [element.text or "" for element in ElementTree.parse(tmp_path / "board.svg").iter()]
        assert _drawable(name).strip() in [text.strip() for text in texts]
    else:
        assert (tmp_path / "board.pdf").read_bytes().endswith(b"%%EOF\n")


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: getattr(board, "dictionary", board.kind))
def test_ink_is_where_the_picture_is_black(board: Checkerboard | Charuco) -> None:
    picture = board.image(round(4 * board.square_mm))
    y, x = (np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5) / 4.0
    inked = shapely.contains_xy(ink_in_board_mm(board), x, y)
    np.testing.assert_array_equal(inked, picture == 0)


@pytest.mark.parametrize("board", [*BOARDS[:2], *BOARDS[-2:]])
def test_no_polygon_overlaps_or_touches_another_along_an_edge(board: Checkerboard | Charuco) -> None:
    ink = ink_in_board_mm(board)
    assert ink.area == pytest.approx(shapely.union_all(ink).area, rel=1e-12)
    polygons = shapely.get_parts(ink)
    tree = shapely.STRtree(polygons)
    one, other = tree.query(polygons, predicate="intersects")
    assert shapely.length(shapely.intersection(polygons[one], polygons[other]))[one != other].max(initial=0.0) == 0.0
    assert shapely.is_ccw(shapely.get_exterior_ring(polygons)).all()


def test_sizes_that_are_no_whole_numbers_of_pixels_are_exact() -> None:
    board = Charuco(cols=4, rows=3, square_mm=12.3, marker_mm=7.77)
    ink = ink_in_board_mm(board)
    assert ink.bounds == pytest.approx((0.0, 0.0, 49.2, 36.9), abs=1e-12)
    # The first marker, in the second square of the first row.
    markers = [polygon for polygon in ink.geoms if shapely.contains_xy(polygon.envelope, 12.3 + 12.3 / 2, 12.3 / 2)]
    low = 12.3 / 2 - 7.77 / 2
    assert shapely.MultiPolygon(markers[:1]).bounds == pytest.approx(
        (12.3 + low, low, 24.6 - low, 12.3 - low), abs=1e-12
    )


def test_ink_of_an_aprilgrid_is_where_its_picture_is_black() -> None:
    board = AprilGrid(cols=3, rows=2, tag_mm=10.0, spacing=0.25)
    picture = board.image(40)
    y, x = (np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5) / 4.0
    np.testing.assert_array_equal(shapely.contains_xy(ink_in_board_mm(board), x, y), picture == 0)


def test_a_board_of_another_program_is_printed_with_its_board_toml(tmp_path: Path) -> None:
    (tmp_path / "charuco.toml").write_text(
        'columns = 5\nrows = 4\ndictionary = "DICT_4X4_50"\nsquare_size_override_cm = 3.0\ninverted = true\n'
    )
    printed_board = print_board(tmp_path / "page" / "mine.pdf", tmp_path / "charuco.toml")
    assert printed_board.description == tmp_path / "page" / "mine.toml"
    assert load_board(printed_board.description) == load_board(tmp_path / "charuco.toml")
    again = print_board(tmp_path / "again.pdf", printed_board.description)
    assert again.description == printed_board.description
    assert not (tmp_path / "again.toml").exists()
