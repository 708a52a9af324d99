"""Attempts with playlists see a reader that follows them."""

from __future__ import annotations

import socket
from typing import Any

import av
import pytest

from benchmarks.robustness.guard import run_monitored
from benchmarks.robustness.native_opens import AUDITED
from benchmarks.robustness.playlists import attempt, listening


@pytest.mark.skipif(not AUDITED, reason="inotify is Linux's")
def test_a_reader_that_opens_other_files_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = av.open

    def by_name(file: Any, **settings: Any) -> Any:
        settings["options"] = {}
        return whole(file if isinstance(file, str) else str(file.name), **settings)

    assert [run_monitored(attempt, seed) for seed in range(40)] == [""] * 40
    monkeypatch.setattr(av, "open", by_name)
    assert any("opens place/other" in run_monitored(attempt, seed) for seed in range(40))


def test_a_reader_that_asks_a_server_is_seen() -> None:
    with listening() as (port, connections):
        socket.create_connection(("127.0.0.1", port)).close()
    assert len(connections) == 1
    with listening() as (_, connections):
        pass
    assert connections == []
