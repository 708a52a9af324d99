"""What a release is made of: one version everywhere, the same bytes twice, a licence for every file."""

from __future__ import annotations

import gzip
import importlib.util
import io
import os
import re
import shutil
import subprocess
import tarfile
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

import mirrorcam
from tests.test_architecture import ROOT

NAMED_IN = ("src/mirrorcam/__init__.py", "CITATION.cff", "ros2/package.xml", "ros2/setup.py", "CHANGELOG.md")


def script(name: str) -> ModuleType:
    """A Python script of `.ci`, as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the files that name the version."""
    for name in NAMED_IN:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def test_everything_that_names_the_version_names_the_same() -> None:
    versions = script("release_version")
    assert versions.version_of(ROOT) == mirrorcam.__version__
    assert versions.disagreements(ROOT) == []


@pytest.mark.parametrize(
    ("name", "old", "new", "complaint"),
    [
        ("CITATION.cff", "version: {}", "version: 9.9.9", "CITATION.cff: version 9.9.9, expected {}"),
        ("ros2/package.xml", "<version>{}", "<version>9.9.9", "ros2/package.xml: version 9.9.9, expected {}"),
        ("ros2/setup.py", '"{}"', '"9.9"', "ros2/setup.py: version missing, expected {}"),
        ("CHANGELOG.md", "## [{}] - ", "## [{}] ", "CHANGELOG.md: no section '## [{}] - YYYY-MM-DD'"),
        ("CITATION.cff", "date-released: 2", "date-released: 1", "CITATION.cff: date-released 1"),
        ("src/mirrorcam/__init__.py", '"{}"', '"{}.dev0"', "version '{}.dev0', expected MAJOR.MINOR.PATCH"),
    ],
)
def test_what_disagrees_is_refused(name: str, old: str, new: str, complaint: str, tree: Path) -> None:
    old, new, complaint = (text.replace("{}", mirrorcam.__version__) for text in (old, new, complaint))
    text = (tree / name).read_text(encoding="utf-8")
    assert old in text
    (tree / name).write_text(text.replace(old, new, 1), encoding="utf-8")
    assert any(complaint in line for line in script("release_version").disagreements(tree))


def archive(order: list[str], mtime: int, mode: int, owner: str) -> bytes:
    packed = io.BytesIO()
    with (
        gzip.GzipFile(fileobj=packed, mode="wb", filename=owner, mtime=mtime) as stream,
        tarfile.open(fileobj=stream, mode="w") as target,
    ):
        for name in order:
            member = tarfile.TarInfo(name)
            member.mtime, member.mode, member.uname, member.size = mtime, mode, owner, len(name)
            target.addfile(member, io.BytesIO(name.encode()))
    return packed.getvalue()


def test_an_sdist_reveals_nothing_about_the_build_machine() -> None:
    settled = script("settle_sdist").settled
    first = settled(archive(["p/a", "p/b"], 1_000, 0o600, "ann"), 5)
    assert first == settled(archive(["p/b", "p/a"], 2_000, 0o664, "ben"), 5)
    assert first != settled(archive(["p/b", "p/a"], 2_000, 0o664, "ben"), 6)
    with tarfile.open(fileobj=io.BytesIO(first)) as read:
        assert [(each.name, each.mtime, each.mode, each.uname) for each in read] == [
            ("p/a", 5, 0o644, ""),
            ("p/b", 5, 0o644, ""),
        ]
        stream = read.extractfile("p/b")
        assert stream is not None
        assert stream.read() == b"p/b"


def test_a_link_in_an_sdist_is_refused() -> None:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as target:
        link = tarfile.TarInfo("p/link")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        target.addfile(link)
    with pytest.raises(SystemExit, match="p/link: neither a file nor a folder"):
        script("settle_sdist").settled(packed.getvalue(), 0)


def git(folder: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=t", "-c", "user.email=t@t", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "-C", str(folder), *identity, *arguments], check=True, capture_output=True)


@pytest.mark.skipif(os.name == "nt" or shutil.which("git") is None, reason="needs a POSIX shell and git")
def test_a_tree_that_is_not_what_the_tag_says_is_refused(tree: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / ".ci", tree / ".ci")
    git(tree, "init", "--quiet")
    git(tree, "add", ".")
    git(tree, "commit", "--quiet", "-m", "All")

    def refused() -> str:
        command = ["bash", str(tree / ".ci" / "release"), str(tmp_path / "out")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert not (tmp_path / "out").exists()
        return done.stderr.strip()

    version = mirrorcam.__version__
    assert refused() == f"release: the commit has no tag v{version}"
    (tree / "left_over.txt").touch()
    assert refused() == "release: the tree has changes that are not committed"
    (tree / "CITATION.cff").write_text("version: 1.0.0\n")
    assert f"release: CITATION.cff: version 1.0.0, expected {version}" in refused()


@pytest.mark.slow
def test_the_release_is_built_and_tried(tmp_path: Path) -> None:
    """The whole script, in a clone of what is committed; it fetches build tools and the base installation."""
    git(ROOT, "clone", "--quiet", str(ROOT), str(tmp_path / "clone"))
    command = ["bash", ".ci/release", "--untagged", str(tmp_path / "out")]
    done = subprocess.run(command, cwd=tmp_path / "clone", capture_output=True, text=True, check=False)
    if re.search("Could not find a version|connection|resolve", done.stderr):
        pytest.skip(f"packages cannot be fetched: {done.stderr.strip()[-200:]}")
    assert done.returncode == 0, done.stderr[-2000:]
    wheel = f"mirrorcam-{mirrorcam.__version__}-py3-none-any.whl"
    names = {"SHA256SUMS", wheel, f"mirrorcam-{mirrorcam.__version__}.tar.gz"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    with tarfile.open(tmp_path / "out" / f"mirrorcam-{mirrorcam.__version__}.tar.gz") as sdist:
        shipped = {name.partition("/")[2] for name in sdist.getnames()}
    tracked = subprocess.run(["git", "-C", str(ROOT), "ls-files"], capture_output=True, text=True, check=True)
    assert set(tracked.stdout.split()) - shipped == set()


def test_the_licences_of_the_tree_are_there_in_full() -> None:
    """`reuse lint` asks for each licence in LICENSES; LICENSE is where people and services look for it."""
    tables = tomllib.loads((ROOT / "REUSE.toml").read_text(encoding="utf-8"))["annotations"]
    named = {name for table in tables for name in table["SPDX-License-Identifier"].split(" AND ")}
    assert {f"{name}.txt" for name in named} == {path.name for path in (ROOT / "LICENSES").iterdir()}
    assert (ROOT / "LICENSES" / "Apache-2.0.txt").read_bytes() == (ROOT / "LICENSE").read_bytes()


@pytest.mark.parametrize("name", ["two_mirror_photos", "two_mirror_video"])
def test_data_of_others_has_its_notice(name: str) -> None:
    folder = ROOT / "tests" / "data" / name
    notice = (folder / "LICENSE").read_text(encoding="utf-8")
    assert "Copyright (c) 2023 Asad Khan, Taimoor Hasan Khan" in notice
    assert "The above copyright notice and this permission notice shall be included" in notice
    assert sum(path.stat().st_size for path in folder.iterdir()) < 5e6
