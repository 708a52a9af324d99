"""Records survive their file, replace those of the same key, and name their source."""

from __future__ import annotations

from pathlib import Path

from benchmarks import records
from benchmarks.records import Figure, Records, table, this_command, this_machine, write_record


def test_a_file_of_records_survives(tmp_path: Path) -> None:
    path, parts = tmp_path / "new.json", table(("part", "mass"), [("mount", "78 g"), ("cap", "")])
    write_record(path, "parts", {"length_px": 1.0})
    write_record(path, "parts", {"mass_g": 78.5, "share": Figure(value=0.5, unit="of 1")}, parts)
    found = Records.load(path).records["parts"]
    assert found.values == {"mass_g": Figure(value=78.5, unit="g"), "share": Figure(value=0.5, unit="of 1")}
    assert found.table == parts
    assert found.machine == this_machine()
    assert found.commit == records._git("rev-parse", "--short=12", "HEAD")


def test_the_command_is_as_typed_without_the_file_of_records() -> None:
    argv = ["/somewhere/benchmarks/decode.py", "--json", "new.json", "--rounds", "90", "/home/me/set"]
    assert this_command(argv) == "python -m benchmarks.decode --rounds 90 set"
