"""`ci_kit/Dockerfile`: its form, and its steps in a fresh root of Debian 12, as no container engine is needed for that.

The slow test needs root, debootstrap and a mirror of Debian. MIRRORCAM_BOOKWORM names a root that debootstrap has made
before (`debootstrap --variant=minbase bookworm FOLDER`), which is copied instead; MIRRORCAM_IMAGE is where the image is
built and kept.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from tests.ci_kit.image_build import (
    Image,
    context,
    ignored,
    instructions,
    of_this_machine,
    patterns_of,
    size_mb,
)
from tests.test_architecture import ROOT

DOCKERFILE = ROOT / "ci_kit" / "Dockerfile"
TINY = """name = "tiny"
version = 1
[[set]]
name = "webcam-2x2"
why = "few mirrors"
design = { rows = 2, cols = 2 }
frames = 8
base_frames = 0
"""


def steps() -> list[tuple[str, str]]:
    return instructions(DOCKERFILE.read_text(encoding="utf-8"))


def test_lines_that_go_on_are_one_instruction() -> None:
    text = "# a comment\nARG BASE=debian:12.12-slim\n\nRUN a \\\n    && b\nENV X=1\n"
    assert instructions(text) == [("ARG", "BASE=debian:12.12-slim"), ("RUN", "a && b"), ("ENV", "X=1")]
    with pytest.raises(ValueError, match="ADD: expected one of"):
        instructions("ADD x /x")


def test_the_base_is_a_point_release_and_never_a_tag_that_moves() -> None:
    (argument, base), (first, of) = steps()[:2]
    assert (argument, first, of) == ("ARG", "FROM", "${BASE}")
    image, _, tag = base.removeprefix("BASE=").partition(":")
    assert image == "debian"
    assert tag.removesuffix("-slim").partition(".")[2].isdigit()


@pytest.mark.parametrize(
    ("name", "left_out"),
    [
        (".git/HEAD", True),
        ("output/default/index.html", True),
        ("optics/geometry/__pycache__/camera.pyc", True),
        ("src/mirrorcam/core/disk/files.py", False),
        ("src/mirrorcam.egg-info/PKG-INFO", True),
        ("cad/web/build.js", False),
        ("build/lib/mirrorcam/cli.py", True),
    ],
)
def test_the_context_leaves_out_what_the_image_does_not_need(name: str, left_out: bool) -> None:
    assert ignored(name, patterns_of((ROOT / ".dockerignore").read_text(encoding="utf-8"))) == left_out


def test_the_context_holds_what_the_steps_read() -> None:
    names = set(context(ROOT))
    assert {"pyproject.toml", "setup.py", "README.md", "LICENSE", "src/mirrorcam/cli.py"} <= names
    assert {
        "ci_kit/install.sh",
        "ci_kit/evaluate.sh",
        "ci_kit/requirements.lock",
        "LICENSES/CERN-OHL-W-2.0.txt",
    } <= names
    entry = next(json.loads(rest) for name, rest in steps() if name == "ENTRYPOINT")
    assert entry[-1].removeprefix("/opt/mirrorcam/") in names


def test_the_image_runs_without_rights_in_a_home_and_a_folder_that_any_user_may_write() -> None:
    settings = dict(steps()[2:])
    user, _, group = settings["USER"].partition(":")
    assert user.isdigit() and group.isdigit() and int(user) > 0
    home = next(rest.removeprefix("HOME=") for name, rest in steps() if name == "ENV" and rest.startswith("HOME="))
    made = next(rest for name, rest in steps() if name == "RUN" and rest.startswith("mkdir -m 1777 "))
    assert {home, settings["VOLUME"], settings["WORKDIR"]} <= set(made.split())
    names = [name for name, _ in steps()]
    assert names.index("USER") > max(place for place, name in enumerate(names) if name in ("RUN", "COPY"))


def test_actions_are_named_by_commits_and_not_by_tags_that_move() -> None:
    files = (ROOT / "action.yml", *sorted((ROOT / ".github" / "workflows").glob("*.yml")))
    used = [line for file in files for line in re.findall(r"uses: (\S+)@(.*)", file.read_text(encoding="utf-8"))]
    assert len(used) == 11
    assert all(re.fullmatch(r"[0-9a-f]{40} # v\d+\.\d+\.\d+", version) for _, version in used)


def test_files_of_the_locked_hashes_alone_are_installed() -> None:
    script = (ROOT / "ci_kit" / "install.sh").read_text(encoding="utf-8")
    commands = [line for line in script.splitlines() if line.startswith("pip ")]
    assert all("--require-hashes" in line or "--no-deps --no-build-isolation" in line for line in commands)
    whole, part = (blocks(ROOT / folder / "requirements.lock") for folder in ("", "ci_kit"))
    assert part <= whole
    assert {"mitsuba", "distributed", "numpy", "setuptools"} <= {block.partition("==")[0] for block in part}


def blocks(lock: Path) -> set[str]:
    """The packages of a lock, each with its version and hashes."""
    lines = lock.read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    return {" ".join(line.split()) for line in lines if not line.startswith("#")}


def refusal() -> str:
    """Why a root cannot be built here; empty where it can."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return "needs root, for debootstrap and chroot"
    if "MIRRORCAM_BOOKWORM" not in os.environ and shutil.which("debootstrap") is None:
        return "needs debootstrap, or MIRRORCAM_BOOKWORM=FOLDER with its result"
    if shutil.which("unshare") is None or subprocess.run(["unshare", "--mount", "true"], check=False).returncode:
        return "needs mount namespaces"
    return ""


@pytest.mark.slow
def test_the_steps_build_an_image_whose_entry_evaluates_a_calibrator(tmp_path: Path) -> None:
    if why := refusal():
        pytest.skip(why)
    keep = os.environ.get("MIRRORCAM_IMAGE")
    root, started = Path(keep) if keep else tmp_path / "root", time.monotonic()
    took: dict[str, float] = {}

    def lap(name: str) -> None:
        took[name] = round(time.monotonic() - started - sum(took.values()), 1)

    if "MIRRORCAM_BOOKWORM" in os.environ:
        subprocess.run(["cp", "-a", os.environ["MIRRORCAM_BOOKWORM"], root], check=True)
    else:
        subprocess.run(["debootstrap", "--variant=minbase", "bookworm", root], check=True, capture_output=True)
    lap("base")
    image, names = Image(root, of_this_machine()), context(ROOT)
    sizes = {"base": size_mb(root)}
    for name, rest in steps():
        image.step(name, rest, ROOT, names)
        if name in ("RUN", "COPY"):
            lap(f"{name} {rest[:40]}")
            sizes[f"{name} {rest[:40]}"] = size_mb(root)

    here = tmp_path / "here"
    shutil.copytree(ROOT / "examples" / "calibrator_in_ci", here)
    (here / "suite.toml").write_text(TINY, encoding="utf-8")
    asked = {"COMMAND": "python3 calibrate.py", "SUITE": "suite.toml", "LIMITS": "limits.toml", "OUT": "found"}
    os.chown(here, *map(int, image.user.split(":")))
    done = image.run(image.entry, passed=asked, mounts=((str(here), "/here"),))
    lap("entry")
    print(json.dumps({"seconds": took, "mb": {name: round(size) for name, size in sizes.items()}}, indent=1))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    found = json.loads((here / "found" / "evaluation.json").read_text(encoding="utf-8"))
    assert found["passed"]
    assert [each["name"] for each in found["tried"]] == ["webcam-2x2"]
    assert found["scores"]["sets"][0]["figures"]["rms_px"]["value"] < 1.0

    wrong = image.run(image.entry, passed=asked | {"COMMAND": "false"}, mounts=((str(here), "/here"),))
    assert wrong.returncode == 1, wrong.stdout[-2000:] + wrong.stderr[-2000:]
