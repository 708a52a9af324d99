"""The steps of a Dockerfile without a container engine: in the root of a fresh Debian, by chroot.

It knows what `ci_kit/Dockerfile` uses: FROM, ARG before it, RUN, COPY of the whole context, ENV, VOLUME, WORKDIR, USER
and ENTRYPOINT.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

KNOWN = ("ARG", "FROM", "RUN", "COPY", "ENV", "VOLUME", "WORKDIR", "USER", "ENTRYPOINT")
FIRST_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
PASSED = ("PIP_", "http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
"""Settings of this machine, by the beginnings of their names, that steps see: where packages come from."""
OUTSIDE = "/srv/of-this-machine"
"""Where files that these settings name are in a root."""
MOUNT = """set -e
root=$1; shift
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
while [ "$1" != -- ]; do
    if [ -d "$1" ]; then mkdir -p "$root$2"; else mkdir -p "$(dirname "$root$2")"; touch "$root$2"; fi
    mount --rbind "$1" "$root$2"; shift 2
done
shift
user=$1; shift
exec chroot --userspec="$user" "$root" "$@"
"""
"""Mounts, in a mount namespace that ends with the process, and the command in the root."""


def instructions(text: str) -> list[tuple[str, str]]:
    """Name and rest of each instruction, lines that go on joined; raises ValueError for one that is not known here."""
    found, begun = [], ""
    for line in text.splitlines():
        if not begun and (not line.strip() or line.lstrip().startswith("#")):
            continue
        begun += line.strip().removesuffix("\\")
        if line.rstrip().endswith("\\"):
            continue
        name, _, rest = begun.partition(" ")
        if name not in KNOWN:
            raise ValueError(f"{name}: expected one of {', '.join(KNOWN)}")
        found.append((name, rest.strip()))
        begun = ""
    return found


def ignored(name: str, patterns: Sequence[str]) -> bool:
    """Whether `.dockerignore` leaves a file out: it, or a folder that it is in, matches a pattern."""
    parts = name.split("/")
    for pattern in patterns:
        anywhere = pattern.removeprefix("**/")
        for depth in range(1, len(parts) + 1):
            if pattern == anywhere:
                if fnmatch("/".join(parts[:depth]), pattern):
                    return True
            elif fnmatch(parts[depth - 1], anywhere):
                return True
    return False


def patterns_of(text: str) -> list[str]:
    """The patterns of a `.dockerignore`."""
    return [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]


def context(root: Path) -> list[str]:
    """The files of a checkout, new ones included, that `.dockerignore` leaves in the context of a build."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=root,
        capture_output=True,
        check=True,
    )
    patterns = patterns_of((root / ".dockerignore").read_text(encoding="utf-8"))
    names = sorted(filter(None, listed.stdout.decode().split("\0")))
    return [name for name in names if not ignored(name, patterns) and (root / name).is_file()]


@dataclass
class Image:
    """A root that is being built: its environment, and what it runs."""

    root: Path
    settings: Mapping[str, str] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=lambda: {"PATH": FIRST_PATH, "HOME": "/root"})
    entry: tuple[str, ...] = ()
    folder: str = "/"
    user: str = "0:0"

    def run(
        self,
        command: Sequence[str],
        *,
        passed: Mapping[str, str] | None = None,
        mounts: Sequence[tuple[str, str]] = (),
    ) -> subprocess.CompletedProcess[str]:
        """A command in the root, with pairs of paths outside and inside that are mounted for it.

        It sees `settings` of this machine, which are no part of the image.
        """
        settings, shared = seen_inside(self.settings)
        variables = [f"{name}={value}" for name, value in (settings | self.environment | dict(passed or {})).items()]
        pairs = [path for pair in (*shared, *mounts) for path in pair]
        inside = ["env", "-i", "-C", self.folder, *variables, *command]
        return subprocess.run(
            ["unshare", "--mount", "--", "sh", "-c", MOUNT, "sh", str(self.root), *pairs, "--", self.user, *inside],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            env=os.environ | {"PATH": f"{os.environ['PATH']}:/usr/sbin:/sbin"},
        )

    def step(self, name: str, rest: str, source: Path, names: Sequence[str]) -> None:
        """One instruction; raises AssertionError with what a command printed where it fails."""
        if name == "ENV":
            key, _, value = rest.partition("=")
            self.environment[key] = value
        elif name == "WORKDIR":
            self.folder = rest
        elif name == "USER":
            self.user = rest
        elif name == "ENTRYPOINT":
            self.entry = tuple(json.loads(rest))
        elif name == "COPY":
            origin, target = rest.split()
            assert origin == ".", f"COPY {origin}: expected the whole context"
            for each in names:
                place = self.root / target.removeprefix("/") / each
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source / each, place)
        elif name == "RUN":
            done = self.run(["sh", "-c", rest])
            assert done.returncode == 0, f"RUN {rest}: {done.stdout[-3000:]}{done.stderr[-3000:]}"


def of_this_machine() -> dict[str, str]:
    """Where this machine gets packages from: pip's configuration as variables, and proxies."""
    found = {name: value for name, value in os.environ.items() if name.startswith(PASSED)}
    listed = subprocess.run(["pip", "config", "list"], capture_output=True, text=True, check=False).stdout
    for line in listed.splitlines():
        key, _, value = line.partition("=")
        scope, _, option = key.partition(".")
        if scope == "global":
            found.setdefault(f"PIP_{option.upper().replace('-', '_')}", value.strip("'"))
    return found


def seen_inside(settings: Mapping[str, str]) -> tuple[dict[str, str], tuple[tuple[str, str], ...]]:
    """Settings as they are in a root, and pairs of paths outside and inside of the files and folders that they name.

    Of an index in a folder, the folder around it is mounted, too, as its pages link to files beside it.
    """
    inside, mounts = {}, set()
    for name, value in settings.items():
        words = []
        for word in value.split(" "):
            path = Path(word.removeprefix("file://"))
            if path.is_absolute() and path.exists():
                mounts.add(path.parent if word.startswith("file://") else path)
                word = word.replace(str(path), f"{OUTSIDE}{path}")
            words.append(word)
        inside[name] = " ".join(words)
    return inside, tuple((str(path), f"{OUTSIDE}{path}") for path in sorted(mounts))


def size_mb(root: Path) -> float:
    """What a root takes on the disk, MB."""
    return (
        int(subprocess.run(["du", "-sk", str(root)], capture_output=True, text=True, check=True).stdout.split()[0])
        / 1e3
    )
