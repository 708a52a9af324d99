"""Labels from tables of DeepLabCut, SLEAP and Anipose and from plain CSV."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.labels.label_files import read_labels
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.solver.observations import DIRECT


def rows(table: LabelTable) -> set[tuple[str, str, str, float, float]]:
    """Frame, view, label and pixel of each row."""
    columns = (table.frame, table.view, table.label, table.pixels)
    return {
        (table.frames[f], table.views[v - DIRECT], table.labels[k], float(x), float(y))
        for f, v, k, (x, y) in zip(*columns, strict=True)
    }


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


EXPECTED = {("0", "direct", "nose", 1.0, 2.0), ("0", "side", "nose", 3.0, 4.0), ("1", "side", "paw", 5.0, 6.0)}
LONG = "frame,view,label,x_px,y_px\n0,direct,nose,1,2\n0,side,nose,3,4\n1,side,paw,5,6\n"
DEEPLABCUT = (
    "scorer,me,me,me,me,me,me,me,me,me\n"
    "bodyparts,nose_direct,nose_direct,nose_direct,side_nose,side_nose,side_nose,paw-side,paw-side,other\n"
    "coords,x,y,likelihood,x,y,likelihood,x,y,x\n"
    "0,1,2,.9,3,4,.9,,,7\n"
    "1,8,8,.1,,,,5,6,7\n"
)
WIDE = "fnum,nose.direct_x,nose.direct_y,nose_side_x,nose_side_y,paw_side_x,paw_side_y\n0,1,2,3,4,,\n1,,,,,5,6\n"
SLEAP = "track,frame_idx,instance.score,nose_direct.x,nose_direct.y,nose_side.x,nose_side.y,paw_side.x,paw_side.y\n"


@pytest.mark.parametrize(
    ("text", "views"),
    [
        (LONG, ()),
        ("# a comment\n" + LONG, ("direct", "side")),
        (DEEPLABCUT, ("direct", "side")),
        (WIDE, ("direct", "side")),
        (SLEAP + ",0,.9,1,2,3,4,,\n,1,.9,,,,,5,6\n", ("direct", "side")),
    ],
    ids=["plain", "commented", "deeplabcut", "anipose", "sleap"],
)
def test_tables(tmp_path: Path, text: str, views: tuple[str, ...]) -> None:
    table = read_labels([written(tmp_path / "labels.csv", text)], views)
    assert table.views == ("direct", "side")
    assert rows(table) == EXPECTED


def test_a_likelihood_and_labels_without_a_view_are_noted(tmp_path: Path) -> None:
    table = read_labels([written(tmp_path / "labels.csv", DEEPLABCUT)], ("direct", "side"))
    assert table.notes == (
        "1 labels belong to no view and are not used: other",
        "1 labels have a likelihood below 0.6 and are not used",
    )


def test_one_table_for_each_view(tmp_path: Path) -> None:
    paths = [
        written(tmp_path / "direct.csv", "frame,nose_x,nose_y\n0,1,2\n"),
        written(tmp_path / "side.csv", "frame,nose_x,nose_y,paw_x,paw_y\n0,3,4,,\n1,,,5,6\n"),
    ]
    assert rows(read_labels(paths)) == EXPECTED
    assert read_labels(paths, ("below", "mirror")).views == ("below", "mirror")


def test_recordings_number_their_own_frames(tmp_path: Path) -> None:
    paths = [written(tmp_path / f"{name}.csv", WIDE) for name in "ab"]
    table = read_labels(paths, ("direct", "side"))
    assert table.frames == ("a.csv 0", "a.csv 1", "b.csv 0", "b.csv 1")
    assert len(table.frame) == 2 * len(EXPECTED)


def test_several_animals(tmp_path: Path) -> None:
    text = "track,frame_idx,nose_direct.x,nose_direct.y,nose_side.x,nose_side.y\na,0,1,2,3,4\nb,0,5,6,7,8\n"
    table = read_labels([written(tmp_path / "labels.csv", text)], ("direct", "side"))
    assert table.labels == ("a nose", "b nose")
    assert ("0", "side", "b nose", 7.0, 8.0) in rows(table)


def test_hdf5_of_sleap(tmp_path: Path) -> None:
    tracks = np.full((1, 2, 3, 2), np.nan)
    tracks[0, :, 0, 0], tracks[0, :, 1, 0], tracks[0, :, 2, 1] = (1, 2), (3, 4), (5, 6)
    with h5py.File(tmp_path / "analysis.h5", "w") as file:
        file["tracks"], file["node_names"] = tracks, [b"nose_direct", b"nose_side", b"paw_side"]
    assert rows(read_labels([tmp_path / "analysis.h5"], ("direct", "side"))) == EXPECTED


def test_hdf5_of_deeplabcut(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "labels.h5", "w") as file:  # as pandas writes its fixed format
        group = file.create_group("df_with_missing")
        group["block0_values"] = [[1, 2, 3, 4, np.nan, np.nan], [np.nan] * 4 + [5, 6]]
        names = ([b"me"], [b"nose_direct", b"nose_side", b"paw_side"], [b"x", b"y"])
        for level, (values, codes) in enumerate(zip(names, ([0] * 6, [0, 0, 1, 1, 2, 2], [0, 1] * 3), strict=True)):
            group[f"block0_items_level{level}"], group[f"block0_items_label{level}"] = values, codes
        group["axis1"] = [0, 1]
    assert rows(read_labels([tmp_path / "labels.h5"], ("direct", "side"))) == EXPECTED


def table_file(path: Path, pickled: bytes) -> Path:
    """Write labels as pandas writes its table format, whose names of columns are pickled."""
    values = np.zeros(2, dtype=[("index", "<i8"), ("values_block_0", "<f8", (6,))])
    values["index"], values["values_block_0"] = [0, 1], [[1, 2, 3, 4, np.nan, np.nan], [np.nan] * 4 + [5, 6]]
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group["table"] = values
        group.attrs["non_index_axes"] = np.bytes_(pickled)
    return path


def test_names_in_a_pickle_are_read_and_nothing_is_run(tmp_path: Path) -> None:
    import pickle

    names = [("me", part, axis) for part in ("nose_direct", "nose_side", "paw_side") for axis in "xy"]
    path = table_file(tmp_path / "labels.h5", pickle.dumps([(1, names)], protocol=0))
    assert rows(read_labels([path], ("direct", "side"))) == EXPECTED
    evil = table_file(tmp_path / "evil.h5", b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match=r"holds os\.system, expected names only"):
        read_labels([evil], ("direct", "side"))


@pytest.mark.parametrize(
    ("text", "views", "message"),
    [
        ("frame,view,label,x_px,y_px\n", (), "no labels"),
        ("a,b\n1,2\n", (), "columns a, b, expected labels of DeepLabCut"),
        ("frame,view,label,x_px,y_px\n0,direct,nose,1,two\n", (), "'two', expected a number"),
        ("frame,view,label,x_px,y_px\n0,direct,nose,1\n", (), "row 2 has 4 cells, expected 5"),
        (LONG + "0,side,nose,9,9\n", (), "label 'nose' occurs twice"),
        (LONG.replace("direct", "below"), (), "no view is called 'direct': give --views"),
        (WIDE, (), "nothing tells its views apart: give --views"),
        ("scorer,me\nbodyparts,nose\n", (), "no rows 'bodyparts' and 'coords'"),
        (LONG.replace("side", "direct").replace("nose,3", "tail,3"), (), "labels of one view"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, views: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_labels([written(tmp_path / "labels.csv", text)], views)


def test_a_file_that_is_no_hdf5_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not an HDF5 file of labels"):
        read_labels([written(tmp_path / "labels.h5", LONG)])
