"""Build the documentation site: `python -m docs.website OUT [--toy FILE.html] [--devices FOLDER]`.

Warnings, including dead links, are errors. Nothing is fetched. OUT is an empty folder or an earlier site. `--toy` adds
a snapshot of the studio to the front page, and `--devices` the gallery of `python -m docs.gallery`, with all files to
print. If missing, they are made first, in about 6 and 16 minutes.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sphinx.cmd.build import build_main

from docs.website.accessible import fix
from docs.website.api_pages import api_pages
from docs.website.command_pages import command_pages
from docs.website.gather import gather

HERE = Path(__file__).parent
MADE_BY_SPHINX = "searchindex.js"
DEVICES_MARK = "<!-- devices -->"
"""Mark that is replaced by a link to the gallery on a site that has one."""
DEVICES_LINK = '<p class="devices"><a href="devices/index.html">Choose a device, with all files to print</a></p>'


def build(out: Path, toy: Path | None = None, devices: Path | None = None) -> int:
    """Build the site into a folder; returns the exit code of Sphinx."""
    with tempfile.TemporaryDirectory() as work:
        pages = Path(work, "pages")
        gather(pages, api_pages() | command_pages())
        tags = ["-t", "toy"] if toy is not None else []
        options = ["-b", "html", "-c", str(HERE), "-d", f"{work}/doctrees", "-W", "--keep-going", "-q", *tags]
        code: int = build_main([*options, str(pages), f"{work}/site"])
        if code:
            return code
        Path(work, "site", ".buildinfo").unlink(missing_ok=True)
        fix(Path(work, "site"))
        if out.exists():
            shutil.rmtree(out)
        shutil.copytree(f"{work}/site", out)
        if toy is not None:
            shutil.copyfile(toy, out / "toy.html")
            _replace(out / "index.html", "TOY_SIZE", f"{toy.stat().st_size / 1e6:.1f} MB")
        if devices is not None:
            shutil.copytree(devices, out / "devices", ignore=shutil.ignore_patterns(".*"))
            for page in ("index.html", "gallery.html"):
                _replace(out / page, DEVICES_MARK, DEVICES_LINK)
    return 0


def _replace(page: Path, mark: str, text: str) -> None:
    """Replace a mark, which must exist, by a text."""
    before, separator, after = page.read_text(encoding="utf-8").partition(mark)
    if not separator:
        raise ValueError(f"{page}: expected {mark}")
    page.write_text(f"{before}{text}{after}", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the site, with a snapshot of the studio and the gallery if requested."""
    parser = argparse.ArgumentParser(prog="python -m docs.website", description=__doc__.split("\n\n")[0])
    parser.add_argument("out", type=Path, help="folder of the site")
    parser.add_argument("--toy", type=Path, metavar="FILE.html", help="snapshot of the studio for the front page")
    parser.add_argument("--devices", type=Path, metavar="FOLDER", help="gallery of `python -m docs.gallery`")
    options = parser.parse_args(arguments)
    out: Path = options.out
    toy: Path | None = options.toy
    devices: Path | None = options.devices
    if out.exists() and any(out.iterdir()) and not (out / MADE_BY_SPHINX).is_file():
        parser.error(f"{out}: is neither an empty folder nor an earlier site")
    for path in (toy, devices):
        if path is not None and path.resolve().is_relative_to(out.resolve()):
            parser.error(f"{path}: expected a path outside {out}, which is replaced")
    if toy is not None and not toy.is_file():
        subprocess.run([sys.executable, "-m", "mirrorcam", "studio", "--snapshot", str(toy)], check=True)
    if devices is not None and not (devices / "index.html").is_file():
        subprocess.run([sys.executable, "-m", "docs.gallery", str(devices)], check=True)
    return build(out, toy, devices)


if __name__ == "__main__":
    sys.exit(main())
