"""One command at a time writes into a folder, and puts its files in place when all of them are finished."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board, save_board
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.npz import save_npz

LAYOUT = Path(__file__).parents[2] / "data" / "default_layout.json"
STAGED = ("", "/parts", "/parts/a.stl")


def contents(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_files_take_their_places_together_when_the_block_ends(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with output_folder(out, "cad") as output:
        with output.staged() as folder:
            (folder / "parts").mkdir()
            (folder / "parts" / "a.stl").write_text("a")
            working = ("holder.json", "lock", "unfinished", *(f"unfinished/files{name}" for name in STAGED))
            assert contents(out) == [HIDDEN, *(f"{HIDDEN}/{name}" for name in working)]
        assert (out / "parts" / "a.stl").read_text() == "a"
    assert contents(out) == [HIDDEN, f"{HIDDEN}/written.jsonl", "parts", "parts/a.stl"]


@pytest.mark.parametrize("error", [InputError, KeyboardInterrupt])
def test_a_block_that_fails_leaves_nothing(error: type[BaseException], tmp_path: Path) -> None:
    with pytest.raises(error), output_folder(tmp_path / "deep" / "out", "cad") as output, output.staged() as folder:
        (folder / "half").write_text("half")
        raise error
    assert contents(tmp_path) == []
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("mine")
    with pytest.raises(error), output_folder(tmp_path / "out", "cad") as output, output.staged() as folder:
        raise error
    assert contents(tmp_path) == ["out", "out/mine"]


@pytest.mark.parametrize("error", [InputError, ValueError, KeyboardInterrupt])
def test_a_finished_result_is_kept_where_what_follows_fails(error: type[BaseException], tmp_path: Path) -> None:
    def work(*names: str) -> None:
        with (
            pytest.raises(error),
            output_folder(tmp_path, "design") as output,
            output.staged(result="layout.json") as folder,
        ):
            for name in names:
                (folder / name).write_text(name)
            raise error

    work("focus.png")
    assert contents(tmp_path) == []
    work("layout.json", "focus.png")
    work("layout.json")
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "layout.json"]


def test_names_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("mine")
    with output_folder(tmp_path, "cameras") as output:
        output.refuse_others("*.yaml")
        with pytest.raises(InputError, match=r"README\.md: was not written by this command"):
            output.refuse_others("*.yaml", "README.md")
    with output_folder(tmp_path, "cameras", force=True) as output:
        output.refuse_others("README.md")
    (tmp_path / "folder").mkdir()
    with output_folder(tmp_path, "cameras", force=True) as output, pytest.raises(InputError, match="is a folder"):
        output.refuse_others("folder")


def test_a_folder_of_others_is_refused_before_the_work(tmp_path: Path) -> None:
    with output_folder(tmp_path, "run") as output:
        output.subfolder("design").refuse_unknown()
        (tmp_path / "design").mkdir()
        output.subfolder("design").refuse_unknown()
        (tmp_path / "design" / "thesis").write_text("mine")
        with pytest.raises(InputError, match="design: holds files that this command did not write"):
            output.subfolder("design").refuse_unknown()


def test_subfolders_have_records_of_their_own(tmp_path: Path) -> None:
    for names in (("a", "b"), ("b",)):
        with output_folder(tmp_path, "run") as output:
            for part in ("one", "two"):
                with output.subfolder(part).staged() as folder:
                    for name in names if part == "one" else ("a",):
                        (folder / name).write_text(part)
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "one", "one/b", "two", "two/a"]


def test_groups_of_files_are_replaced_each_by_itself(tmp_path: Path) -> None:
    for names in (("a", "b"), ("b",)):
        with output_folder(tmp_path, "sweep") as output:
            for group in ("one", "two"):
                with output.grouped(group).staged() as folder:
                    for name in names if group == "one" else ("a",):
                        (folder / f"{group}-{name}").write_text(name)
    assert contents(tmp_path) == [HIDDEN, f"{HIDDEN}/written.jsonl", "one-b", "two-a"]
    (tmp_path / "two-a").write_text("mine")
    with output_folder(tmp_path, "sweep") as output:
        output.grouped("one").refuse_others("one-b")
        with pytest.raises(InputError, match="two-a: was changed since this command wrote it, expected it removed"):
            output.grouped("two").refuse_others("two-a")


HOLDS = """
import sys, time
from pathlib import Path
from mirrorcam.core.disk.output_folder import output_folder
with output_folder(Path(sys.argv[1]), "decode") as output:
    with output.staged() as folder:
        (folder / "half").write_text("half")
        print("held", flush=True)
        time.sleep(60)
"""


def test_the_second_process_says_who_holds_the_folder_and_a_dead_holder_holds_nothing(tmp_path: Path) -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        busy = rf"out: in use by mirrorcam decode, process {holder.pid} on .+ since \d{{4}}-.* UTC, expected it to end"
        with pytest.raises(InputError, match=busy), output_folder(tmp_path / "out", "depth"):
            pass
        assert (tmp_path / "out" / HIDDEN / "unfinished" / "files" / "half").exists()
    finally:
        holder.send_signal(signal.SIGKILL if os.name != "nt" else signal.SIGTERM)
        holder.communicate()
    with output_folder(tmp_path / "out", "decode") as output, output.staged() as folder:
        assert contents(folder) == []
        (folder / "whole").write_text("whole")
    assert contents(tmp_path / "out") == [HIDDEN, f"{HIDDEN}/written.jsonl", "whole"]


@pytest.mark.parametrize("kind", ["file", "link"])
def test_a_hidden_folder_of_somebody_else_is_refused(kind: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "theirs").mkdir()
    if kind == "file":
        (out / HIDDEN).write_text("mine")
    else:
        (out / HIDDEN).symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="expected none or a new --out"), output_folder(out, "cad"):
        pass
    assert contents(tmp_path / "theirs") == []


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    for path in (tmp_path / "out", tmp_path / "out" / "deeper"):
        with pytest.raises(InputError, match=r"is a file|cannot be written"), output_folder(path, "cad"):
            pass
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize("link", ["unfinished", "unfinished/files"])
def test_unfinished_files_that_a_link_hides_are_not_removed(link: str, tmp_path: Path) -> None:
    (tmp_path / "theirs" / "files").mkdir(parents=True)
    (tmp_path / "theirs" / "thesis").write_text("mine")
    (tmp_path / "theirs" / "files" / "thesis").write_text("mine")
    path = tmp_path / "out" / HIDDEN / link
    path.parent.mkdir(parents=True)
    path.symlink_to(tmp_path / "theirs")
    with output_folder(tmp_path / "out", "cad") as output, output.staged() as folder:
        (folder / "a").write_text("a")
    assert contents(tmp_path / "theirs") == ["files", "files/thesis", "thesis"]
    assert (tmp_path / "out" / "a").read_text() == "a"


@pytest.mark.parametrize("name", ["written.jsonl", "lock", "holder.json"])
def test_nothing_is_written_through_a_link_in_the_hidden_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / "out" / HIDDEN).mkdir(parents=True)
    (tmp_path / "out" / HIDDEN / name).symlink_to(tmp_path / "thesis")
    with pytest.raises(InputError, match=f"{name}: is a link"), output_folder(tmp_path / "out", "cad"):
        pass
    assert (tmp_path / "thesis").read_text() == "mine"


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """A folder that another process holds, with inputs beside it, and what is said of its holder."""
    folder = tmp_path_factory.mktemp("held")
    Layout.load(LAYOUT).save(folder / "layout.json")
    save_board(folder / "board.toml", default_board())
    light_field = folder / "picture.npz"
    save_npz(light_field, Decoder(Layout.load(LAYOUT), width_px=16).decode(np.zeros((1080, 1920, 3), np.uint8)))
    write_image(folder / "picture.png", np.zeros((1080, 1920, 3), np.uint8))
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, str(folder / "out")], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    yield folder, f"out: in use by mirrorcam decode, process {holder.pid} on "
    holder.kill()
    holder.communicate()


@pytest.mark.parametrize(
    "command",
    [
        "design --out out",
        "sweep --counts 1x2 --out out",
        "cad layout.json --out out",
        "picture layout.json --out out/picture.jpg",
        "board --out out/board.pdf",
        "render layout.json --frames 1 --base-frames 0 --renderer fast --out out",
        "scene layout.json --out out",
        "calibrate picture.png --board board.toml --layout layout.json --out out",
        "cameras layout.json --out out",
        "decode picture.png --layout layout.json --out out",
        "refocus picture.npz --out out",
        "epi picture.npz --out out",
        "depth picture.npz --out out",
        "features picture.npz --out out",
        "track picture.npz second.npz --out out",
        "export picture.npz --to hci --out out",
        "validate set --out out",
        "run --quick --out out",
    ],
)
def test_every_command_says_who_holds_its_folder(
    command: str, held: tuple[Path, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, says = held
    monkeypatch.chdir(folder)
    before = contents(folder)
    assert cli.main(command.split()) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"mirrorcam: {says}") and said.count("\n") == 1
    assert contents(folder) == before
