"""What is built and installed: one import package, whole, typed, and unharmed by others of the folders' names."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
from collections.abc import Iterable
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.test_architecture import FOLDERS, ROOT

pytestmark = pytest.mark.slow

NOT_SHIPPED = ("__pycache__",)
OUR_FOLDERS = ("optics", "cad", "render_scenes")


def python(executable: Path | str, *arguments: str, cwd: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run an interpreter that sees neither this checkout nor the user's settings."""
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(executable), *arguments], capture_output=True, text=True, cwd=cwd, env=surroundings, check=False
    )
    assert not check or done.returncode == 0, f"{arguments}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done


def built(kind: str, source: Path, out: Path) -> Path:
    """The wheel, sdist or editable wheel of a source tree, made by setuptools alone."""
    out.mkdir(parents=True, exist_ok=True)
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(out)!r}))"
    return out / python(sys.executable, "-c", code, cwd=source).stdout.splitlines()[-1]


def files_of_the_tree() -> set[str]:
    """Where each module and data file of the four folders belongs in the installation, and the tested versions."""
    return {"mirrorcam/constraints.txt"} | {
        Path(*package.split("."), path.relative_to(folder)).as_posix()
        for package, folder in FOLDERS.items()
        for path in folder.rglob("*")
        if path.is_file() and not set(path.relative_to(folder).parts) & {*NOT_SHIPPED}
    }


def differing(first: Path, second: Path) -> list[str]:
    """The files that two wheels do not share byte by byte."""
    one, other = (
        {(name, archive.read(name)) for name in archive.namelist()} for archive in map(ZipFile, (first, second))
    )
    return sorted(name for name, _ in one ^ other)


def differences(shipped: Iterable[str], expected: set[str]) -> list[str]:
    """What a wheel lacks, and what it has beside that and its own metadata."""
    inside = {name for name in shipped if not name.split("/")[0].endswith(".dist-info")}
    missing = [f"{name} is missing" for name in sorted(expected - inside)]
    return missing + [f"{name} does not belong" for name in sorted(inside - expected)]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what builds need, without links and other leftovers; skips without the setuptools of the dev extra."""
    if find_spec("setuptools") is None or int(metadata.version("setuptools").split(".")[0]) < 77:
        pytest.skip("needs setuptools 77 or newer, of the extra dev")
    copy = tmp_path_factory.mktemp("checkout")
    for folder in FOLDERS.values():
        ignored = shutil.ignore_patterns(*NOT_SHIPPED)
        shutil.copytree(folder, copy / folder.relative_to(ROOT), symlinks=True, ignore=ignored)
    for name in OUR_FOLDERS:
        (copy / "src" / "mirrorcam" / name).unlink(missing_ok=True)
    for name in ("setup.py", "pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "constraints.txt"):
        shutil.copy(ROOT / name, copy / name)
    shutil.copytree(ROOT / "LICENSES", copy / "LICENSES")
    return copy


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("wheel", checkout, tmp_path_factory.mktemp("wheel"))


class Installation:
    """A fresh environment with a wheel, in which the packages of this one are visible beside it."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        venv.create(folder)
        self.folder = folder
        self.python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
        self.packages = Path(self.run("import sysconfig; print(sysconfig.get_path('purelib'))"))
        # A wheel without compiled code is installed where it is unpacked, but for the command's script.
        ZipFile(wheel).extractall(self.packages)
        # Editable installations here are no packages there: what is listed in a .pth file is not asked for its own.
        shared = [path for path in sys.path if Path(path).name in {"site-packages", "dist-packages"}]
        (self.packages / "shared.pth").write_text("\n".join(shared) + "\n")

    def run(self, code: str) -> str:
        return python(self.python, "-c", code, cwd=self.folder).stdout.strip()


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """The wheel in an environment of its own."""
    return Installation(tmp_path_factory.mktemp("installed"), wheel)


@pytest.fixture(scope="module")
def clone(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout for an editable installation; its folder has the name of the package."""
    return Path(shutil.copytree(checkout, tmp_path_factory.mktemp("clone") / "mirrorcam"))


@pytest.fixture(scope="module")
def editable(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """The clone, installed as editable: its `src/mirrorcam` has the links."""
    return Installation(tmp_path_factory.mktemp("editable"), built("editable", clone, clone.parent))


def test_the_wheel_holds_every_file_of_the_tree_and_nothing_else(wheel: Path) -> None:
    names = ZipFile(wheel).namelist()
    assert differences(names, files_of_the_tree()) == []
    expected = {
        "py.typed",
        "optics/geometry/cameras/c920.toml",
        "optics/geometry/cameras/d435.toml",
        "cad/web/page.html",
    }
    assert {f"mirrorcam/{name}" for name in expected} <= set(names)


def test_the_check_sees_what_is_missing_and_what_does_not_belong() -> None:
    expected = files_of_the_tree()
    broken = (expected - {"mirrorcam/optics/geometry/layout.py"}) | {"optics/__init__.py", "mirrorcam-1.dist-info/x"}
    assert differences(broken, expected) == [
        "mirrorcam/optics/geometry/layout.py is missing",
        "optics/__init__.py does not belong",
    ]


def test_builds_start_from_scratch_and_skip_folders_that_are_not_packages(checkout: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(checkout, copy)
    (copy / "optics" / "camera_files" / "write" / "__init__.py").unlink()
    left_by_an_earlier_version = copy / "build" / "lib" / "optics" / "__init__.py"
    left_by_an_earlier_version.parent.mkdir(parents=True)
    left_by_an_earlier_version.touch()
    shipped = ZipFile(built("wheel", copy, tmp_path)).namelist()
    lacking = {name for name in files_of_the_tree() if name.startswith("mirrorcam/optics/camera_files/write/")}
    assert differences(shipped, files_of_the_tree()) == [f"{name} is missing" for name in sorted(lacking)]


def test_the_source_distribution_builds_the_same_wheel(checkout: Path, wheel: Path, tmp_path: Path) -> None:
    with tarfile.open(built("sdist", checkout, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert differing(wheel, built("wheel", source, tmp_path / "again")) == []


@pytest.mark.usefixtures("editable")
def test_links_in_the_checkout_change_neither_wheel_nor_sdist(
    clone: Path, checkout: Path, wheel: Path, tmp_path: Path
) -> None:
    assert {path.name for path in (clone / "src" / "mirrorcam").iterdir() if path.is_symlink()} == {*OUR_FOLDERS}
    assert differing(wheel, built("wheel", clone, tmp_path)) == []
    plain, linked = (built("sdist", tree, tmp_path / tree.name) for tree in (checkout, clone))
    with tarfile.open(plain) as expected, tarfile.open(linked) as shipped:
        assert sorted(shipped.getnames()) == sorted(expected.getnames())


def test_what_takes_the_place_of_a_link_is_refused_and_kept(checkout: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(checkout, copy)
    theirs = copy / "src" / "mirrorcam" / "cad" / "theirs.txt"
    theirs.parent.mkdir()
    theirs.touch()
    with pytest.raises(AssertionError, match="cad: expected a link to "):
        built("editable", copy, tmp_path)
    assert theirs.is_file()


def test_packages_of_the_folders_names_come_and_go_without_harm(installed: Installation) -> None:
    assert Path(installed.run("import mirrorcam; print(mirrorcam.__file__)")).is_relative_to(installed.packages)
    others = [installed.packages / name for name in OUR_FOLDERS]
    for other in others:
        other.mkdir()
        (other / "__init__.py").write_text("theirs = True\n")
    code = "import optics, cad, render_scenes, mirrorcam.cad, mirrorcam.optics; print(optics.theirs, cad.theirs)"
    assert installed.run(code) == "True True"
    for other in others:
        shutil.rmtree(other)
    assert installed.run("import mirrorcam.optics.geometry.layout as m; print(m.Layout.__name__)") == "Layout"


def test_an_editable_installation_is_the_checkout(editable: Installation, clone: Path, tmp_path: Path) -> None:
    built("editable", clone, tmp_path)  # once more: the links are there already
    added = clone / "optics" / "geometry" / "added_later.py"
    added.touch()
    code = (
        "from importlib.util import find_spec\n"
        "for name in ('core.values', 'optics.geometry.added_later', 'cad.plan.dimension', 'cli'):\n"
        "    print(find_spec(f'mirrorcam.{name}').origin)\n"
        f"print([name for name in {OUR_FOLDERS!r} if find_spec(name)])"
    )
    *places, bare = editable.run(code).splitlines()
    added.unlink()
    inside = ("core/values.py", "optics/geometry/added_later.py", "cad/plan/dimension.py", "cli.py")
    assert [Path(place) for place in places] == [clone / "src" / "mirrorcam" / name for name in inside]
    assert bare == "[]"


@pytest.mark.parametrize("kind", ["installed", "editable"])
def test_a_checkout_in_the_working_directory_does_not_hide_the_installation(
    kind: str, clone: Path, request: pytest.FixtureRequest
) -> None:
    """Python searches the working directory first, and may be started in a checkout or in the folder that holds it."""
    installation: Installation = request.getfixturevalue(kind)
    packages = clone / "src" if kind == "editable" else installation.packages
    code = "import mirrorcam, mirrorcam.core.values as m; print(m.__file__, mirrorcam.Layout.__name__, sep='\\n')"
    for place in (clone.parent, clone):
        found, name = python(installation.python, "-c", code, cwd=place).stdout.splitlines()
        assert (Path(found), name) == (packages / "mirrorcam" / "core" / "values.py", "Layout")


def test_optics_and_the_public_names_need_nothing_of_the_extras(installed: Installation) -> None:
    code = """
import importlib, pkgutil, sys
for extra in ("build123d", "OCP", "trimesh", "manifold3d", "ezdxf", "lib3mf", "markdown_it", "mitsuba",
              "drjit", "OpenEXR", "dask", "distributed", "pyarrow"):
    sys.modules[extra] = None
import mirrorcam.optics
for name in mirrorcam.__all__:
    getattr(mirrorcam, name)
names = [module.name for module in pkgutil.walk_packages(mirrorcam.optics.__path__, "mirrorcam.optics.")]
for name in names:
    importlib.import_module(name)
print(len(names))
"""
    assert int(installed.run(code)) > 100


@pytest.mark.parametrize("kind", ["installed", "editable"])
def test_type_checkers_see_the_types_of_the_installed_package(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    installation: Installation = request.getfixturevalue(kind)
    snippet, settings = tmp_path / "snippet.py", tmp_path / "mypy.ini"
    snippet.write_text(
        "import mirrorcam\n"
        "from mirrorcam.optics.geometry.layout import Layout\n"
        "reveal_type(Layout)\n"
        "reveal_type(mirrorcam.design)\n"
        "mirrorcam.x\n"
    )
    # What others ship is not followed: whether ours is typed does not hang on it, and most of the time does.
    settings.write_text("[mypy]\nfollow_imports = skip\n[mypy-mirrorcam.*]\nfollow_imports = silent\n")
    options = ("--config-file", str(settings), "--cache-dir", str(tmp_path / "cache"))
    seen_from = ("--python-executable", str(installation.python))
    printed = python(sys.executable, "-m", "mypy", *options, *seen_from, str(snippet), cwd=tmp_path, check=False).stdout
    layout, design = (line for line in printed.splitlines() if "Revealed type" in line)
    assert "-> mirrorcam.optics.geometry.layout.Layout" in layout
    assert "(spec: mirrorcam.optics.geometry.design_spec.DesignSpec" in design
    assert "-> mirrorcam.optics.geometry.layout.Layout" in design
    assert 'snippet.py:5: error: Module has no attribute "x"' in printed
    assert "Found 1 error" in printed


def test_the_lock_has_the_tested_versions_with_hashes() -> None:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    locked = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"\S+==[^;]*(;.*?)?(\s+--hash=sha256:[0-9a-f]{64})+", line) for line in locked)
    pinned = {re.sub(r"[-_.]+", "-", line.split()[0].lower()) for line in locked}
    tested = [line for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split() if "==" in line]
    assert {re.sub(r"[-_.]+", "-", each.lower()) for each in tested} <= pinned
