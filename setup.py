"""Which folder holds which package: one import package, `mirrorcam`, from four folders.

Everything else about the distribution is in `pyproject.toml`.
"""

import shutil
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

FOLDERS = {
    "mirrorcam": "src/mirrorcam",
    "mirrorcam.optics": "optics",
    "mirrorcam.cad": "cad",
    "mirrorcam.render_scenes": "render_scenes",
}


class BuildAnew(build_py):
    """Empties `build/lib` first: what is left there of an earlier version would be packed into the wheel.

    `constraints.txt`, the versions that were tested, goes into the package: `mirrorcam doctor` compares with it.
    """

    def run(self) -> None:
        if not self.editable_mode:
            shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()
        if not self.editable_mode:
            self.copy_file("constraints.txt", str(Path(self.build_lib, "mirrorcam", "constraints.txt")))


class EditableFromSrc(editable_wheel):
    """Puts `src` on the path, where `mirrorcam` finds its other packages by itself.

    The import hook that setuptools would install for four folders is asked only after the whole path was searched: a
    folder named `mirrorcam` in the working directory, such as a checkout, would hide the package.
    """

    def finalize_options(self) -> None:
        self.distribution.package_dir = {"": "src"}
        self.distribution.packages = find_packages("src")
        super().finalize_options()


setup(
    package_dir=FOLDERS,
    packages=[
        package
        for root, folder in FOLDERS.items()
        for package in (root, *(f"{root}.{inside}" for inside in find_packages(folder)))
    ],
    cmdclass={"build_py": BuildAnew, "editable_wheel": EditableFromSrc},
)
