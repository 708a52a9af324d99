"""The documents say what docs/measured.json holds, and every number that looks measured is taken from there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks.records import Figure, Record, Records, table
from docs.make_measured import GUARDED, MADE, MEASURED, amiss, blocks, main, numbers, pages, quoted, unowned, written

ROOT = Path(__file__).parents[2]


def records() -> Records:
    return Records.load(MEASURED)


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def some(**values: float) -> Records:
    record = Record(
        command="python -m benchmarks.some",
        date="2026-11-25",
        commit="0123456789ab",
        machine="a machine",
        values={name: Figure(value=value) for name, value in values.items()},
        table=table(("", "error"), [("fast", "0.07 s"), ("slow", "")]),
    )
    return Records(records={"some": record})


def test_documents_say_what_is_measured() -> None:
    assert amiss(records()) == []


def test_pages_are_all_that_users_read() -> None:
    named = {page.relative_to(ROOT).as_posix() for page in pages()}
    assert {*GUARDED, "CONTRIBUTING.md", "SECURITY.md", "docs/guides/maker.md", "ros2/README.md"} <= named


def test_the_table_of_the_gallery_is_that_of_its_record() -> None:
    text = text_of("docs/gallery.md")
    assert MADE["docs/gallery.md"](text) == text
    assert MADE["docs/gallery.md"](text.replace("| 403 g |", "| 404 g |")) == text


def test_every_record_says_where_it_is_from() -> None:
    for key, record in records().records.items():
        assert re.fullmatch(r"[0-9a-f]{12}", record.commit), key
        assert record.command, key
        assert record.transcribed == isinstance(record.machine, str), key
        assert not record.changed, key
        assert record.values or record.table, key


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a C920, H.264, x1, 1080p", ["1080"]),
        ("0.5 to .75 of 15,660, 3e-8 µm", ["0.5", ".75", "15,660", "3e-8"]),
        ("off by -0.2 (-23.1), 10-20, ISO 9409-1", ["-0.2", "-23.1", "10", "9409"]),
        ("908.313 ± 0.015°, 13.7, 16.4", ["908.313", "0.015", "13.7", "16.4"]),
        ("`--step 4`, [a](b#3), https://a.b/5 and 6", ["6"]),
        ("1. first 2\n![3 views](4.png) of 5", ["2", "5"]),
        ("28.7→12.1, 2,3", ["28.7", "12.1", "2", "3"]),
    ],
)
def test_numbers_are_those_outside_of_code_links_and_words(text: str, found: list[str]) -> None:
    assert [number[0] for number in numbers(text)] == found


@pytest.mark.parametrize(
    ("value", "like", "text"),
    [
        (0.012986, "0.013", "0.013"),
        (0.012986, "0.5", "0.0"),
        (0.5361, ".570", ".536"),
        (-0.33, "-.25", "-.33"),
        (15660.0, "15,000", "15,660"),
        (15660.0, "1500", "15660"),
        (2.58e-8, "3e-8", "3e-8"),
        (2.58e-8, "2.7e-9", "2.6e-8"),
        (12000000.0, "1.2e6", "1.2e7"),
    ],
)
def test_a_figure_is_rounded_to_what_the_document_quotes(value: float, like: str, text: str) -> None:
    assert quoted(value, like) == text


def test_figures_are_written_in_order_and_given_numbers_stay() -> None:
    text = "<!-- figures: some: a_px 3\n     b*100 -->\nUp to 0.12 px in 3 views,\n7 % of them.\n\n8 more."
    new, wrong = written(text, some(a_px=0.346, b=0.128))
    assert wrong == []
    assert new == text.replace("0.12", "0.35").replace("7 %", "13 %")


def test_a_table_is_replaced_as_a_whole() -> None:
    new, wrong = written("# T\n\n<!-- table: some -->\n| old |\n|---|\n| 1 |\n\nEnd.\n", some())
    assert wrong == []
    assert new == "# T\n\n<!-- table: some -->\n| | error |\n|---|---|\n| fast | 0.07 s |\n| slow | |\n\nEnd.\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- figures: some: a_px -->\n0.1 px of 3", "2 numbers, but the comment above names 1"),
        ("<!-- figures -->\n0.1 px of 3", "2 numbers, but the comment above names 0"),
        ("<!-- figures: some: a_px 4 -->\n0.1 px of 3", "3 where the comment above has 4"),
        ("<!-- figures: some: c_px 3 -->\n0.1 px of 3", "'c_px' is no figure"),
        ("<!-- figures: a_px 3 -->\n0.1 px of 3", "'a_px' is no figure"),
        ("<!-- figures: other: a_px 3 -->\n0.1 px of 3", "no record 'other'"),
        ("<!-- table: other -->\n| a |\n|---|", "no table 'other'"),
    ],
)
def test_what_cannot_be_written_is_said_with_its_line(text: str, message: str) -> None:
    new, wrong = written(f"Page.\n\n{text}", some(a_px=0.1))
    assert len(wrong) == 1
    assert wrong[0].startswith("4: ")
    assert message in wrong[0]
    assert new == f"Page.\n\n{text}"


def test_a_table_in_a_list_stays_indented_and_indented_code_is_no_text() -> None:
    text = "- Sizes:\n\n  <!-- table: some -->\n  | a |\n  |---|\n\n    f = 3 x\n"
    new, wrong = written(text, some())
    assert wrong == []
    assert "\n  | | error |\n  |---|---|\n  | fast | 0.07 s |\n  | slow | |\n\n" in new
    assert unowned(text) == []


def test_numbers_without_a_comment_are_found() -> None:
    text = "# 1 heading\n\n```sh\nrun 2\n```\n\nSome 3 and 4 px.\n\n<!-- figures: 5 -->\nGiven 5.\n\n| a | 6 |\n"
    assert [line.split()[1] for line in unowned(text)] == ["3", "4", "6"]
    assert [line.split()[:2] for line in unowned(text, "units")] == [["7:", "4"]]
    assert [line.split()[:2] for line in unowned(text, "tables")] == [["12:", "6"]]


def test_what_a_page_says_is_given_needs_no_comment() -> None:
    text = (
        "# Page\n\n<!-- given: 300 mm, 5 grey levels,\n10,000 px -->\n\nAt 300\nmm 5 grey levels, 10,000 px, {}, 4.\n"
    )
    assert unowned(text.format("300 mm"), "units") == []
    assert unowned(text.format("300 mm"), "all")[0].startswith("7: 4 without")
    assert [line.split()[:2] for line in unowned(text.format("301 mm"), "units")] == [["7:", "301"]]
    assert unowned(text.format("3").replace("10,000 px,", ""), "units") == ["3: 10,000px is given, but stands nowhere"]


def test_a_comment_in_indented_code_is_an_example() -> None:
    text = "Such as\n\n    <!-- figures: none: a_px -->\n    <!-- given: 3 px -->\n\n4 px.\n"
    assert written(text, some()) == (text, [])
    assert [line.split()[:2] for line in unowned(text, "units")] == [["6:", "4"]]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_changed_digit_is_noticed_wherever_figures_are(page: Path) -> None:
    lines, held = page.read_text(encoding="utf-8").split("\n"), records()
    for block in (block for block in blocks(lines) if block.kind):
        text = "\n".join([f"<!-- {block.kind}: {block.body} -->", *lines[block.start : block.stop]])
        assert written(text, held) == (text, [])
        place = numbers(text)[-1].end() - 1
        other = f"{text[:place]}{(int(text[place]) + 1) % 10}{text[place + 1 :]}"
        new, wrong = written(other, held)
        assert wrong or new == text, other


def test_a_changed_record_is_noticed_until_the_documents_are_written() -> None:
    text, held = text_of("docs/measured.md"), records()
    record = held.records["default_run"]
    name = "validation.held_out_rms_x_px"
    other = held.with_records({"default_run": record.replaced(values=record.values | {name: Figure(value=0.02)})})
    new, wrong = written(text, other)
    assert wrong == []
    assert new != text
    assert written(new, other) == (new, [])


def test_the_command_takes_new_records_and_checks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "docs").mkdir()
    page = tmp_path / "README.md"
    page.write_text("<!-- figures: some: a_px -->\nOff by 0.100 px.\n", encoding="utf-8")
    measured = tmp_path / "docs" / "measured.json"
    some(a_px=0.1).save(measured)
    monkeypatch.setattr("docs.make_measured.ROOT", tmp_path)
    monkeypatch.setattr("docs.make_measured.MEASURED", measured)
    assert main(["--check"]) == 0
    some(a_px=0.2).save(tmp_path / "new.json")
    assert main(["--check", "--take", str(tmp_path / "new.json")]) == 1
    told = capsys.readouterr().err
    assert "README.md: differs from measured.json" in told
    assert "+Off by 0.200 px." in told
    assert main(["--take", str(tmp_path / "new.json")]) == 0
    assert page.read_text(encoding="utf-8").endswith("Off by 0.200 px.\n")
    assert json.loads(measured.read_text(encoding="utf-8"))["records"]["some"]["values"]["a_px"]["value"] == 0.2
    assert main(["--check"]) == 0
