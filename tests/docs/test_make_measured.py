"""The page of measured figures."""

from __future__ import annotations

from benchmarks.records import Records
from docs.make_measured import PAGE, RECORDS, page


def test_the_page_is_what_the_command_writes_from_the_records() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(Records.load(RECORDS))
