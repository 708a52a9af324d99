"""Which folder holds which package: one import package, `mirrorcam`, from four top-level folders.

Everything else about the distribution is in `pyproject.toml`.
"""

from setuptools import find_packages, setup

FOLDERS = {
    "mirrorcam": "mirrorcam",
    "mirrorcam.optics": "optics",
    "mirrorcam.cad": "cad",
    "mirrorcam.render_scenes": "render_scenes",
}

setup(
    package_dir=FOLDERS,
    packages=[
        package
        for root, folder in FOLDERS.items()
        for package in (root, *(f"{root}.{inside}" for inside in find_packages(folder)))
    ],
)
