"""Digests of bytes, values and files."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.disk.fingerprint import differing_keys, digest, file_digest, file_digests, intact, value_digest
from mirrorcam.core.errors import InputError

# sha256 of "abc", from FIPS 180-4.
ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_digests_are_sha256_of_the_content(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    for name in ("deep/b.txt", "a.txt"):
        (tmp_path / name).write_bytes(b"abc")
    assert digest(b"a", b"bc") == file_digest(tmp_path / "a.txt") == ABC
    assert file_digests(tmp_path / "a.txt") == {"a.txt": ABC}
    assert list(file_digests(tmp_path).items()) == [("a.txt", ABC), ("deep/b.txt", ABC)]


def test_a_value_has_one_digest_whatever_the_order_of_its_keys() -> None:
    assert (
        value_digest({"a": 1, "b": [2.0]}) == value_digest({"b": [2.0], "a": 1}) != value_digest({"a": 1, "b": [3.0]})
    )


def test_intact_files_are_there_with_their_content(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
    files = {"a": digest(b"a"), "b": digest(b"other"), "c": digest(b"c")}
    assert intact(tmp_path, files) == {"a": digest(b"a")}


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "link/secret", "a\x00b", "x" * 5000, "\ud800"])
def test_no_name_of_a_file_leads_out_of_its_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "secret").write_text("theirs")
    (tmp_path / "set" / "link").symlink_to(tmp_path)
    with pytest.raises(InputError, match="expected the name of a file in this folder"):
        intact(tmp_path / "set", {name: digest(b"theirs")})


def test_differing_names_are_those_of_either_side() -> None:
    assert differing_keys({"a": 1, "b": 2, "c": None}, {"b": 3, "a": 1}) == ["b", "c"]
