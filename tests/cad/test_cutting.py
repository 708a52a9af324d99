"""The sheet of mirrors as a laser cutter reads it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import ezdxf.filemanagement
import numpy as np
from shapely import LineString, Polygon

from cad.cutting import mark, outline_from_back, place_mirrors, write_dxf
from cad.hardware import HARDWARE
from optics.layout import Layout


def test_seen_from_the_back_right_is_rig_x_and_up_is_rig_z(default_layout: Layout) -> None:
    for mirror in default_layout.mirrors:
        flat = outline_from_back(mirror)
        rig = mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0)
        # The axes of the drawing in rig: (right, up, towards someone behind the mirror) must be right-handed.
        right, up = (np.linalg.lstsq(rig, flat[:, axis], rcond=None)[0] for axis in (0, 1))
        assert right[0] > 0.8
        assert up[2] > 0.4
        assert np.cross(right, up) @ mirror.normal_in_rig < -0.999


def test_the_sheet_is_laid_out_like_the_holder_seen_from_behind(default_layout: Layout) -> None:
    placed = place_mirrors(default_layout, HARDWARE)
    middles = np.array([cut.outline.mean(axis=0) for cut in placed]).reshape(3, 3, 2)
    assert (np.diff(middles[..., 0], axis=1) > 0).all()
    assert (np.diff(middles[..., 1], axis=0) < 0).all()
    outlines = [Polygon(cut.outline) for cut in placed]
    for index, outline in enumerate(outlines):
        assert all(outline.distance(other) >= HARDWARE.cutting.gap_mm - 1e-9 for other in outlines[index + 1 :])
        assert all(outline.contains(LineString(stroke)) for stroke in placed[index].strokes)


def test_a_mark_shrinks_to_fit_and_points_up() -> None:
    wide = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]])
    shaft = mark("0-1", wide, 5.0)[0]
    np.testing.assert_allclose(shaft[1] - shaft[0], [0.0, 5.0])
    strokes = mark("10-11", wide / 8.0, 5.0)
    assert np.ptp(np.vstack(strokes)[:, 1]) < 3.0
    assert all(Polygon(wide / 8.0).contains(LineString(stroke)) for stroke in strokes)
    # One arrow of two strokes, and one stroke for each of 1, 0, -, 1, 1.
    assert len(strokes) == 7


def test_the_file_says_its_unit_and_its_side(default_layout: Layout, tmp_path: Path) -> None:
    write_dxf(tmp_path / "mirrors.dxf", default_layout, HARDWARE)
    drawing = ezdxf.filemanagement.readfile(tmp_path / "mirrors.dxf")
    assert drawing.header["$INSUNITS"] == 4
    (note,) = drawing.modelspace().query("TEXT")
    assert "seen from the back (engraved side up)" in note.dxf.text
    assert "first-surface 1 mm" in note.dxf.text
    assert note.dxf.layer == "NOTES"
    assert not drawing.audit().errors


def test_the_same_mirrors_give_the_same_bytes_whatever_the_order_of_sets(
    default_layout: Layout, tmp_path: Path
) -> None:
    default_layout.save(tmp_path / "layout.json")
    program = (
        "import sys; from pathlib import Path; from optics.layout import Layout; from cad.cutting import write_dxf;"
        "from cad.hardware import HARDWARE;"
        "write_dxf(Path(sys.argv[2]), Layout.load(Path(sys.argv[1])), HARDWARE)"
    )
    files = [tmp_path / f"{seed}.dxf" for seed in (1, 2, 4, 7)]
    for file in files:
        command = [sys.executable, "-c", program, str(tmp_path / "layout.json"), str(file)]
        subprocess.run(command, check=True, env=os.environ | {"PYTHONHASHSEED": file.stem})
    assert len({file.read_bytes() for file in files}) == 1
