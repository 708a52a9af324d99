"""`mirrorcam live` as it is typed."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cli import parse
from mirrorcam.core.values import InputError
from mirrorcam.studio.live.live_command import LiveOptions
from tests.command_line import assert_refused


def test_a_source_is_a_camera_unless_it_is_stated() -> None:
    options = parse(["live", "--layout", "layout.json"]).command
    assert isinstance(options, LiveOptions)
    assert options.source == "0" and options.layout == Path("layout.json") and options.board is None
    named = parse(["live", "video.mp4", "--layout", "a.json", "--board", "b.toml", "--view-width-px", "200"]).command
    assert isinstance(named, LiveOptions)
    assert (named.source, named.view_width_px, named.board) == ("video.mp4", 200, Path("b.toml"))


@pytest.mark.parametrize("wrong", [["--layout", "a.json", "--depth-width-px", "0"], [], ["", "--layout", "a.json"]])
def test_bad_options_are_refused(wrong: list[str]) -> None:
    with pytest.raises((InputError, SystemExit)):
        parse(["live", *wrong])


def test_a_layout_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    assert_refused(tmp_path, "live 0 --layout none.json --no-browser --port 0", "none.json: no such file")
