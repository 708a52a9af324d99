"""Which folder holds which package: one import package, `mirrorcam`, from four top-level folders.

Everything else about the distribution is in `pyproject.toml`.
"""

import shutil

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

FOLDERS = {
    "mirrorcam": "mirrorcam",
    "mirrorcam.optics": "optics",
    "mirrorcam.cad": "cad",
    "mirrorcam.render_scenes": "render_scenes",
}


class BuildAnew(build_py):
    """Empties `build/lib` first: what is left there of an earlier version would be packed into the wheel."""

    def run(self) -> None:
        if not self.editable_mode:
            shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()


setup(
    package_dir=FOLDERS,
    packages=[
        package
        for root, folder in FOLDERS.items()
        for package in (root, *(f"{root}.{inside}" for inside in find_packages(folder)))
    ],
    cmdclass={"build_py": BuildAnew},
)
