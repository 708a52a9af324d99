"""What is built and installed: one import package, whole, typed, and unharmed by others of the folders' names."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from collections.abc import Iterable
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.test_architecture import FOLDERS, ROOT

NOT_SHIPPED = ("__pycache__",)
# The default optimum of the smallest array; the command as a user types it.
DESIGN = ("design", "--rows", "1", "--cols", "2", "--out", "designed")
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


def differences(shipped: Iterable[str], expected: set[str]) -> list[str]:
    """What a wheel lacks, and what it has beside that and its own metadata."""
    inside = {name for name in shipped if not name.split("/")[0].endswith(".dist-info")}
    missing = [f"{name} is missing" for name in sorted(expected - inside)]
    return missing + [f"{name} does not belong" for name in sorted(inside - expected)]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what builds need, without what earlier builds left; skips without the setuptools of the dev extra."""
    if find_spec("setuptools") is None or int(metadata.version("setuptools").split(".")[0]) < 77:
        pytest.skip("needs setuptools 77 or newer, of the extra dev")
    copy = tmp_path_factory.mktemp("checkout")
    for folder in FOLDERS.values():
        shutil.copytree(folder, copy / folder.relative_to(ROOT), ignore=shutil.ignore_patterns(*NOT_SHIPPED))
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
        zipfile.ZipFile(wheel).extractall(self.packages)
        # Editable installations here are no packages there: what is listed in a .pth file is not asked for its own.
        shared = [path for path in sys.path if Path(path).name in {"site-packages", "dist-packages"}]
        (self.packages / "shared.pth").write_text("\n".join(shared) + "\n")

    def run(self, code: str) -> str:
        return python(self.python, "-c", code, cwd=self.folder).stdout.strip()

    def pip(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        common = ("--python", str(self.python), "--disable-pip-version-check", "--quiet")
        return python(sys.executable, "-m", "pip", *common, *arguments, cwd=self.folder, check=False)

    def design(self) -> Path:
        """The layout that the installed command designs."""
        python(self.python, "-m", "mirrorcam", *DESIGN, cwd=self.folder)
        return self.folder / "designed" / "layout.json"


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """The wheel in an environment of its own."""
    return Installation(tmp_path_factory.mktemp("installed"), wheel)


def test_the_wheel_holds_every_file_of_the_tree_and_nothing_else(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
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


def test_builds_start_anew_and_miss_a_folder_that_is_no_package(checkout: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(checkout, copy)
    (copy / "optics" / "exports" / "__init__.py").unlink()
    left_by_an_earlier_version = copy / "build" / "lib" / "optics" / "__init__.py"
    left_by_an_earlier_version.parent.mkdir(parents=True)
    left_by_an_earlier_version.touch()
    shipped = zipfile.ZipFile(built("wheel", copy, tmp_path)).namelist()
    lacking = {name for name in files_of_the_tree() if name.startswith("mirrorcam/optics/exports/")}
    assert differences(shipped, files_of_the_tree()) == [f"{name} is missing" for name in sorted(lacking)]


def test_the_source_distribution_builds_the_same_wheel(checkout: Path, wheel: Path, tmp_path: Path) -> None:
    with tarfile.open(built("sdist", checkout, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = (path for path in tmp_path.iterdir() if path.is_dir())
    again = zipfile.ZipFile(built("wheel", source, tmp_path / "again"))
    first = zipfile.ZipFile(wheel)
    assert sorted(again.namelist()) == sorted(first.namelist())
    assert [name for name in first.namelist() if first.read(name) != again.read(name)] == []


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


def test_optics_and_cad_of_the_index_come_and_go_without_harm(wheel: Path, tmp_path: Path) -> None:
    if find_spec("pip") is None:
        pytest.skip("needs pip")
    installed = Installation(tmp_path / "environment", wheel)
    fetched = installed.pip("install", "--no-deps", "optics", "cad")
    if fetched.returncode:
        pytest.skip(f"optics and cad cannot be fetched from the package index: {fetched.stderr.strip()[-200:]}")
    versions = "import importlib.metadata as m; print(m.version('optics'), m.version('cad'))"
    assert len(installed.run(versions).split()) == 2
    assert installed.design().is_file()
    assert installed.pip("uninstall", "--yes", "optics", "cad").returncode == 0
    assert installed.run("import mirrorcam.optics.geometry.layout as m; print(m.Layout.__name__)") == "Layout"
    python(installed.python, "-m", "mirrorcam", "design", "--help", cwd=installed.folder)


def test_an_editable_installation_is_the_checkout(checkout: Path, tmp_path: Path) -> None:
    installation = Installation(tmp_path / "environment", built("editable", checkout, tmp_path))
    code = (
        "from importlib.util import find_spec\n"
        "for name in ('optics.base.values', 'cad.plan.dimension', 'cli'):\n"
        "    print(find_spec(f'mirrorcam.{name}').origin)\n"
        f"print([name for name in {OUR_FOLDERS!r} if find_spec(name)])"
    )
    *places, bare = installation.run(code).splitlines()
    inside = ("optics/base/values.py", "cad/plan/dimension.py", "src/mirrorcam/cli.py")
    assert [Path(place) for place in places] == [checkout / name for name in inside]
    assert bare == "[]"


@pytest.mark.parametrize("kind", ["wheel", "editable"])
def test_a_checkout_in_the_working_directory_does_not_hide_the_installation(
    kind: str, checkout: Path, wheel: Path, tmp_path: Path
) -> None:
    """Python searches the working directory first, and may be started in a checkout or in the folder that holds it."""
    clone = tmp_path / "mirrorcam"
    shutil.copytree(checkout, clone)
    installation = Installation(tmp_path / "environment", wheel if kind == "wheel" else built(kind, clone, tmp_path))
    expected = clone / "optics" if kind == "editable" else installation.packages / "mirrorcam" / "optics"
    code = (
        "import mirrorcam, mirrorcam.optics.base.values as m; print(m.__file__, mirrorcam.Layout.__name__, sep='\\n')"
    )
    for place in (clone.parent, clone):
        found, name = python(installation.python, "-c", code, cwd=place).stdout.splitlines()
        assert (Path(found), name) == (expected / "base" / "values.py", "Layout")


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


def test_type_checkers_see_the_types_of_the_installed_package(installed: Installation, tmp_path: Path) -> None:
    snippet, settings = tmp_path / "snippet.py", tmp_path / "mypy.ini"
    snippet.write_text("import mirrorcam\nreveal_type(mirrorcam.Layout)\nreveal_type(mirrorcam.design)\nmirrorcam.x\n")
    # What others ship is not followed: whether ours is typed does not hang on it, and most of the time does.
    settings.write_text("[mypy]\nfollow_imports = skip\n[mypy-mirrorcam.*]\nfollow_imports = silent\n")
    options = ("--config-file", str(settings), "--cache-dir", str(tmp_path / "cache"))
    seen_from = ("--python-executable", str(installed.python))
    printed = python(sys.executable, "-m", "mypy", *options, *seen_from, str(snippet), cwd=tmp_path, check=False).stdout
    layout, design = (line for line in printed.splitlines() if "Revealed type" in line)
    assert "-> mirrorcam.optics.geometry.layout.Layout" in layout
    assert "(spec: mirrorcam.optics.geometry.design_spec.DesignSpec" in design
    assert "-> mirrorcam.optics.geometry.layout.Layout" in design
    assert 'snippet.py:4: error: Module has no attribute "x"' in printed


def test_the_lock_has_the_tested_versions_with_hashes() -> None:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    locked = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"\S+==[^;]*(;.*?)?(\s+--hash=sha256:[0-9a-f]{64})+", line) for line in locked)
    pinned = {re.sub(r"[-_.]+", "-", line.split()[0].lower()) for line in locked}
    tested = [line for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split() if "==" in line]
    assert {re.sub(r"[-_.]+", "-", each.lower()) for each in tested} <= pinned
