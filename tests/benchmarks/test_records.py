"""Records of benchmarks: files that survive, tables in Markdown, units, and where a record is from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import records
from benchmarks.records import (
    Figure,
    Record,
    Records,
    short,
    table,
    this_command,
    this_machine,
    unit_of,
    write_record,
)
from mirrorcam.core.values import InputError

PARTS = table(("part", "mass"), [("mount", "78 g"), ("cap", "")])


def test_a_file_of_records_survives_and_has_a_line_for_each_figure(tmp_path: Path) -> None:
    path = tmp_path / "new.json"
    write_record(path, "parts", {"mass_g": 78.5, "share": Figure(value=0.5, unit="of 1")}, PARTS)
    write_record(path, "counts", {"devices": 200})
    found = Records.load(path)
    assert list(found.records) == ["counts", "parts"]
    assert found.records["parts"].values["mass_g"] == Figure(value=78.5, unit="g")
    assert found.records["parts"].table == PARTS
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    assert '"mass_g": {"value": 78.5, "unit": "g"},' in lines
    assert '["mount", "78 g"],' in lines
    assert '"devices": {"value": 200}' in lines
    found.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_a_record_replaces_the_one_before(tmp_path: Path) -> None:
    write_record(tmp_path / "a.json", "one", {"a_px": 1.0})
    write_record(tmp_path / "a.json", "one", {"b_px": 2.0})
    assert list(Records.load(tmp_path / "a.json").records["one"].values) == ["b_px"]


def test_without_a_file_nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records, "record_of", lambda *_: pytest.fail("asked for a record"))
    write_record(None, "one", {"a_px": 1.0})


@pytest.mark.parametrize("text", ["[]", '{"schema": "mirrorcam.measured/2", "records": {}}', '{"records": {"a": {}}}'])
def test_a_file_that_holds_no_records_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"bad\.json"):
        Records.load(path)


def test_a_record_says_where_it_is_from(tmp_path: Path) -> None:
    write_record(tmp_path / "a.json", "one", {"a_px": 1.0})
    record = Records.load(tmp_path / "a.json").records["one"]
    assert record.machine == this_machine()
    assert record.commit == records._git("rev-parse", "--short=12", "HEAD")
    here = this_machine()
    assert here.cores >= 1
    assert here.memory_gb > 0
    assert all([here.cpu, here.system, here.python])


@pytest.mark.parametrize(
    ("name", "unit"),
    [("worst_px", "px"), ("a.tilt_deg", "°"), ("rate_hz", "1/s"), ("px", "px"), ("ratio", ""), ("maps", "")],
)
def test_the_unit_is_the_end_of_the_name(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_the_command_is_as_typed_without_the_file_of_records() -> None:
    argv = ["/somewhere/benchmarks/design_start.py", "--json", "new.json", "--folds", "90", "/home/me/set"]
    assert this_command(argv) == "python -m benchmarks.design_start --folds 90 set"


def test_a_record_has_a_date_and_a_commit() -> None:
    with pytest.raises(ValueError, match="date"):
        Record.model_validate_json(json.dumps({"command": "c", "commit": "0", "machine": "m"}))


@pytest.mark.parametrize(
    ("value", "sign", "text"),
    [
        (0.6051, "", ".605"),
        (-0.0214, "+", "-.021"),
        (0.0014, "+", "+.001"),
        (-0.0004, "+", ".000"),
        (12.5, "", "12.500"),
    ],
)
def test_short_numbers_have_no_zero_before_their_point(value: float, sign: str, text: str) -> None:
    assert short(value, sign=sign) == text
