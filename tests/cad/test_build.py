"""A complete build: its files, the same bytes twice, reused parts, and errors in one line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

import pytest

import mirrorcam.cad.build
import mirrorcam.cad.checks.elasticity.elasticity_report
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.guide.picture_views import DevicePicture
from mirrorcam.cad.plan.back_table import BACKS, DeskBack, back_of
from mirrorcam.cad.plan.device_names import files_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.core.disk.results import Results
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.conftest import COVERED
from tests.nightly import a_few
from tests.shared import no_slicer, path_without_slicer

Built = tuple[Layout, Path, dict[str, Metric]]


def names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_the_same_layout_gives_the_same_bytes_in_other_processes(built_second_surface: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_second_surface
    layout.save(tmp_path / "layout.json")
    program = (
        "import sys; from pathlib import Path\n"
        "from mirrorcam.cad.build import build_parts\n"
        "from mirrorcam.optics.geometry.layout import Layout\n"
        "from tests.cad.conftest import COVERED\n"
        "if __name__ == '__main__':\n"
        "    build_parts(Layout.load(Path(sys.argv[1])), Path(sys.argv[2]), COVERED, workers=2)\n"
    )
    (tmp_path / "program.py").write_text(program)
    again = tmp_path / "again"
    subprocess.run(
        [sys.executable, str(tmp_path / "program.py"), str(tmp_path / "layout.json"), str(again)],
        check=True,
        env=os.environ
        | {"PYTHONHASHSEED": "7", "PYTHONPATH": os.pathsep.join(sys.path), "PATH": path_without_slicer()},
    )
    assert names(again) == names(folder)
    assert [name for name in sorted(names(again)) if (again / name).read_bytes() != (folder / name).read_bytes()] == []


def test_every_file_is_listed_in_advance(built_default: Built) -> None:
    written = names(built_default[1])
    found = {pattern: {name for name in written if fnmatchcase(name, pattern)} for pattern in files_of(HARDWARE)}
    assert written == set().union(*found.values())
    # One stock sheet, and every part fits the bed, so that only names of plates have a number.
    assert [pattern for pattern, matching in found.items() if not matching and "_[0-9]*" not in pattern] == []


@pytest.mark.parametrize("kind", BACKS)
def test_a_back_has_the_parts_that_its_table_states(kind: str, device: Device) -> None:
    hardware = HARDWARE.replaced(back=back_of(kind))
    back = plan_back(device.clip, device.mount, hardware)
    assert tuple(part.name for part in back.parts) == hardware.back.parts
    assert (back.robot is not None) == hardware.back.on_arm
    assert {f"parts/{part.name}.stl" for part in back.parts} <= set(files_of(hardware))
    assert ("robot/mirrorcam.urdf" in files_of(hardware)) == hardware.back.on_arm


def test_carriers_and_elasticity_have_files_only_where_they_are_asked_for() -> None:
    screws = HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors="screws"))
    carrier, elastic = "parts/carrier_0-1.stl", "robot/gravity.json"
    assert any(fnmatchcase(carrier, pattern) for pattern in files_of(screws))
    assert not any(fnmatchcase(carrier, pattern) for pattern in files_of(HARDWARE))
    assert set(files_of(HARDWARE, elastic=True)) - set(files_of(HARDWARE)) >= {elastic, "elasticity.md"}


def refuse_to_make(*_: object) -> BuiltPart:
    raise AssertionError("a part is made that could have been taken over")


def copy_picture(folder: Path, out: Path, picture: DevicePicture) -> None:
    (out / "pictures").mkdir(exist_ok=True)
    shutil.copy(folder / picture.path, out / picture.path)


@pytest.mark.slow
def test_unchanged_parts_are_reused(
    built_second_surface: Built, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout, folder, _ = built_second_surface
    monkeypatch.setattr("mirrorcam.cad.part_files.write_step", refuse_to_make)
    # Pictures are rendered in each build, with the same bytes, as the test above shows.
    monkeypatch.setattr("mirrorcam.cad.device_files.write_picture", partial(copy_picture, folder))
    reported: list[tuple[int, int]] = []
    with no_slicer():
        kept = folder.with_name("kept")
        build_parts(layout, tmp_path / "again", COVERED, results=kept, progress=lambda *counts: reported.append(counts))
    assert reported == [(done, reported[0][1]) for done in range(reported[0][1] + 1)]
    assert names(tmp_path / "again") == names(folder)
    for name in sorted(names(folder)):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


@pytest.mark.slow
def test_changed_parts_are_made_again(
    built_second_surface: Built, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mirrorcam.cad.assembly.catalogue import parts_of
    from mirrorcam.cad.assembly.device_plan import plan_device
    from mirrorcam.cad.part_files import make_part

    layout, folder, _ = built_second_surface
    made: list[str] = []

    def note(_: Path, solid: object, *_others: object) -> None:
        made.append(str(getattr(solid, "label", "")))
        raise InterruptedError

    monkeypatch.setattr("mirrorcam.cad.part_files.write_step", note)

    def remade(plans: tuple[PartPlan, ...], results: Results) -> list[str]:
        made.clear()
        for plan in plans:
            try:
                with no_slicer():
                    make_part(plan, HARDWARE.printer, tmp_path / "new", results)
            except InterruptedError:
                continue
        return list(made)

    wider = HARDWARE.replaced(back=DeskBack(tip_deg=20.0))
    changed = remade(parts_of(plan_device(layout, wider)), Results(folder.with_name("kept")))
    assert "adapter_desk" in changed
    assert "mirror_holder" not in changed
    assert "camera_clip" not in changed


def test_a_device_that_cannot_be_built_is_refused_before_any_file(
    make_parabola: Callable[..., Layout], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="mm apart as cut from sheet"):
        build_parts(make_parabola(2, 2, gap_mm=0.1), tmp_path / "parts")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file_is_refused(small_layout: Layout, tmp_path: Path) -> None:
    (tmp_path / "parts").write_text("")
    with pytest.raises(InputError, match="parts: is a file, expected a new or empty folder"):
        build_parts(small_layout, tmp_path / "parts")


@pytest.mark.parametrize("missing", a_few(1, ["manifold3d", "build123d", "jinja2"]))
def test_a_missing_extra_is_named_with_its_command(
    missing: str, small_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = ("mirrorcam.cad.build", "mirrorcam.cad.plan.hardware")
    for name in [name for name in sys.modules if name.startswith("mirrorcam.cad.") and name not in loaded]:
        # A module imported again also replaces the one in its package: both are restored afterwards.
        package, _, child = name.rpartition(".")
        monkeypatch.setattr(sys.modules[package], child, sys.modules[name])
    for name in [name for name in sys.modules if name.startswith("mirrorcam.cad.") and name not in loaded]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(InputError, match=rf'^{missing} is not installed.*: pip install "mirrorcam\[cad\]"$'):
        mirrorcam.cad.build.build_parts(small_layout, tmp_path)
    # A module missing for another reason is a bug, not an incomplete installation.
    monkeypatch.setitem(sys.modules, missing, type(sys)(missing))
    monkeypatch.setitem(sys.modules, "mirrorcam.cad.write.part_export", None)
    with pytest.raises(ImportError):
        mirrorcam.cad.build.build_parts(small_layout, tmp_path)


def test_without_gmsh_finite_elements_are_refused_before_the_work(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mirrorcam.cad.checks.elasticity.elasticity_report, "gmsh_program", lambda: None)
    with pytest.raises(InputError, match=r"gmsh is not installed.*mirrorcam\[fe\]"):
        build_parts(default_layout, tmp_path / "device", elastic=True)
    assert not (tmp_path / "device").exists()
