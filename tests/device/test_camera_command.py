"""`mirrorcam camera`: the list of cameras, all about one of them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.device.camera_command import described, list_rows
from mirrorcam.optics.geometry.camera_library import CAMERAS, camera_names, read_profile
from tests.command_line import assert_refused_here


def test_the_list_has_every_camera_with_its_view_and_number_of_guesses(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["camera", "list"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in camera_names())
    rows = {row[0]: row[1:] for row in list_rows()}
    guesses = len(read_profile("c920").guessed) + len(read_profile("c920").body.guessed)
    assert rows["c920"] == ("1920 x 1080", "70.4 x 43.3", "1.80 mm", str(guesses), "1 of 2", "Logitech C920")
    assert rows["pi_camera_2"][4] == "0 of 2"
    assert rows["board_38"][:3] == ("any lens", "-", "-")


@pytest.mark.parametrize("name", camera_names())
def test_everything_about_a_camera_has_its_sources_and_guesses(name: str) -> None:
    profile = read_profile(name)
    lines = described(profile)
    assert [text for title, text in lines if title == "camera"] == [profile.name]
    assert len([title for title, _ in lines if title == "source"]) == len(profile.sources)
    assert len([title for title, _ in lines if title == "published"]) == len(profile.disagreements)
    guessed = next(text for title, text in lines if title == "guessed")
    assert all(guess in guessed for guess in (*profile.guessed, *profile.body.guessed))
    recalled = [text for title, text in lines if title == "source" and text.endswith("(from memory)")]
    assert len(recalled) == sum(source.from_memory for source in profile.sources)


def test_one_camera_is_shown_by_its_name_or_its_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["camera", "show", "d435"]) == 0
    by_name = capsys.readouterr().out
    assert "focal_mm 1.88; here +3.2%: 1.88 mm over 1.4 um would see 71.1 deg" in by_name
    assert cli.main(["camera", "show", str(CAMERAS / "d435.toml")]) == 0
    assert capsys.readouterr().out == by_name


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("camera keep", "unknown command 'keep', expected list, show, new, export (see mirrorcam camera --help)"),
        ("camera show", "expected NAME (see mirrorcam camera show --help)"),
        ("camera list c920", "c920"),
        ("camera show nikon", "camera 'nikon': expected one of arducam_b0196"),
        ("camera show nikon.toml", "nikon.toml: no such file"),
        ("design --camera nikon", "camera 'nikon': expected one of arducam_b0196"),
        ("design --camera board_38", "the focal length is unknown"),
    ],
)
def test_bad_names_are_refused_in_one_line(
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(arguments.split(), capfd, expected)
    assert list(tmp_path.iterdir()) == []
