"""`mirrorcam live`: its source, its layout and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mirrorcam import cli
from mirrorcam.studio.live.values import LiveRequest
from mirrorcam.studio.serve import Opening
from tests.command_line import assert_refused, assert_refused_here


def test_a_source_is_a_camera_unless_it_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[tuple[LiveRequest | None, Path | None, str]] = []

    def serve(opening: Opening, **options: Any) -> int:
        served.append((opening.camera, opening.board, opening.fragment))
        return 0

    monkeypatch.setattr("mirrorcam.studio.serve.serve", serve)
    assert cli.main(["live", "--layout", "layout.json"]) == 0
    assert cli.main(["live", "video.mp4", "--layout", "a.json", "--board", "b.toml"]) == 0
    assert served == [
        (LiveRequest(Path("layout.json"), "0"), None, "tab=camera"),
        (LiveRequest(Path("a.json"), "video.mp4"), Path("b.toml"), "tab=camera"),
    ]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--layout", "a.json", "--port", "70000"], "--port '70000': expected 0 to 65535"),
        ([], "expected --layout"),
        (["", "--layout", "a.json"], "SOURCE is empty"),
    ],
)
def test_bad_options_are_refused(arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert_refused_here(["live", *arguments], capsys, expected)


@pytest.mark.slow
def test_a_layout_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    assert_refused(tmp_path, "live 0 --layout none.json --no-browser --port 0", "none.json: no such file")
