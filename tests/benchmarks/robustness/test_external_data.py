"""An MP4 is rewritten box by box, and its references to its own data become those to another file."""

from __future__ import annotations

from benchmarks.robustness.external_data import _boxes, with_external_data
from benchmarks.robustness.playlists import video


def test_all_but_the_references_stays() -> None:
    before, after = _boxes(video()), _boxes(with_external_data(video(), "/folder/other.mkv"))
    assert [name for name, _ in after] == [name for name, _ in before]
    assert {name for (name, old), (_, new) in zip(before, after, strict=True) if old != new} == {"moov"}


def test_the_references_name_the_file() -> None:
    raw = with_external_data(video(), "/folder/other.mkv")
    at = raw.index(b"dref")
    assert raw[at + 16 : at + 20] == b"alis"
    assert b"volume/folder/other.mkv" in raw[at:]
    assert b"url " not in raw[at : at + 300]
