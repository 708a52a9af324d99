"""Attempts with playlists see a reader that follows them; videos that are none of them are read."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import av
import pytest

from benchmarks.robustness.guard import watched
from benchmarks.robustness.native_opens import AUDITED
from benchmarks.robustness.playlists import ENDINGS, LISTS, PREFIXES, attempt, listening, video
from mirrorcam.core.video.video import Video


@pytest.mark.parametrize("ending", ["mp4", "m3u8", "ffconcat", "MP4"])
def test_a_video_is_read_whatever_its_ending(tmp_path: Path, ending: str) -> None:
    assert ending in ENDINGS
    path = tmp_path / f"a.{ending}"
    path.write_bytes(video())
    assert len(list(Video(path).frames())) == Video(path).count


@pytest.mark.skipif(not AUDITED, reason="inotify is Linux's")
def test_a_reader_that_opens_other_files_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = av.open

    def by_name(file: Any, **settings: Any) -> Any:
        settings["options"] = {}
        return whole(file if isinstance(file, str) else str(file.name), **settings)

    assert [watched(attempt, seed) for seed in range(40)] == [""] * 40
    monkeypatch.setattr(av, "open", by_name)
    assert any("opens place/other" in watched(attempt, seed) for seed in range(40))


def test_a_reader_that_asks_a_server_is_seen() -> None:
    with listening() as (port, asked):
        socket.create_connection(("127.0.0.1", port)).close()
    assert len(asked) == 1
    with listening() as (_, asked):
        pass
    assert asked == []


def test_every_list_names_its_target() -> None:
    assert len(set(PREFIXES)) == len(PREFIXES)
    for listed in LISTS:
        assert "../other.mkv" in listed("../other.mkv")
