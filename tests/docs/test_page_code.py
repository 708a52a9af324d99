"""Pages run from first line to last on a machine without camera, display, network and ROS."""

from __future__ import annotations

import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

from docs.make_tour import TOUR, illustrations
from docs.page_code import Block, blocks, run_page

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "docs" / "start.md", TOUR, *sorted((ROOT / "docs" / "guides").glob("*.md"))]
CLONED = ("ci_kit", "examples", "tests/data/two_mirror_video")
"""Folders of a clone of the repository, in which some guides begin."""
NEEDS = {"a browser", "a camera", "ffmpeg", "ROS 2", "the network"}
PAGE = """
```toml
# a.toml
rows = 2
```

```sh
cp a.toml b.toml     # a copy
false                # needs a camera
# needs ROS 2
exit 1
cd /tmp && echo "#1"
```

```text
false
```

```python
open("c.toml", "w").write(open("b.toml").read())
```
"""


def test_blocks_run_in_order_in_one_folder(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    assert [block.language for block in blocks(PAGE)] == ["toml", "sh", "python"]
    assert blocks(PAGE, "sh")[0].commands == [
        ("cp a.toml b.toml", ""),
        ("false", "a camera"),
        ("exit 1", "ROS 2"),
        ('cd /tmp && echo "#1"', ""),
    ]
    run_page(page, tmp_path)
    assert (tmp_path / "c.toml").read_text() == "# a.toml\nrows = 2\n"


@pytest.mark.parametrize("block", [Block("sh", "false\ntrue\n"), Block("python", "raise SystemExit(1)\n")])
def test_a_command_that_fails_ends_the_run(block: Block, tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError):
        block.run(tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_needs_of_commands_are_few(page: Path) -> None:
    needs = [needs for block in blocks(page.read_text(encoding="utf-8"), "sh") for _, needs in block.commands]
    assert {each for each in needs if each} <= NEEDS
    assert needs.count("") >= len(needs) / 2


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_runs_from_first_line_to_last(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in CLONED:
        shutil.copytree(ROOT / name, tmp_path / name)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("BROWSER", "true")  # the shell's command, which opens nothing
    run_page(page, tmp_path)
    if page == TOUR:
        made_of = {name for each in illustrations(page.read_text(encoding="utf-8")) for name in each.made_of}
        assert {name for name in made_of if not (tmp_path / name).is_file()} == set()
