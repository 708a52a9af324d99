"""One import package, `mirrorcam`, from four folders; everything else about the distribution is in `pyproject.toml`."""

import os
import shutil
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

LINKED = ("optics", "cad", "render_scenes")
FOLDERS = {"mirrorcam": "src/mirrorcam"} | {f"mirrorcam.{name}": name for name in LINKED}


def link(name: str) -> None:
    """Link a folder of the checkout into the package: a junction on Windows, where symbolic links need privileges."""
    place, folder = Path("src/mirrorcam", name), Path(name)
    if os.path.lexists(place):
        if not (place.exists() and place.samefile(folder)):
            raise SystemExit(f"{place}: expected a link to {folder.absolute()}; move away what is there")
    elif os.name == "nt":
        import _winapi

        _winapi.CreateJunction(str(folder.absolute()), str(place.absolute()))
    else:
        place.symlink_to(Path("../..", name))


class BuildAnew(build_py):
    """Empties `build/lib` first: what is left there of an earlier version would be packed into the wheel.

    `constraints.txt`, the versions that were tested, goes into the package: `mirrorcam doctor` compares with it.
    """

    def run(self) -> None:
        if self.editable_mode:
            return
        shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()
        self.copy_file("constraints.txt", str(Path(self.build_lib, "mirrorcam", "constraints.txt")))


class EditableFromSrc(editable_wheel):
    """Puts `src` on the path, in which links complete the package: tools that read files see what Python imports."""

    def finalize_options(self) -> None:
        for name in LINKED:
            link(name)
        self.distribution.package_dir = {"": "src"}
        super().finalize_options()


setup(
    package_dir=FOLDERS,
    # A set: where the links are, `find_packages` sees the linked packages in `src/mirrorcam` too.
    packages=sorted(
        {
            package
            for root, folder in FOLDERS.items()
            for package in (root, *(f"{root}.{inside}" for inside in find_packages(folder)))
        }
    ),
    cmdclass={"build_py": BuildAnew, "editable_wheel": EditableFromSrc},
)
