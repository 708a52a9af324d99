"""Names from other people's files are one line of text, and stay text in every format."""

from __future__ import annotations

import csv
from html.parser import HTMLParser
from io import StringIO

import pytest
import yaml
from markdown_it import MarkdownIt
from pydantic import TypeAdapter, ValidationError

from mirrorcam.core.names import (
    LONGEST,
    Link,
    Name,
    drawable,
    fitted,
    markdown_text,
    number,
    numbers,
    spreadsheet_text,
    word,
)
from tests.hostile_names import ACCEPTED, REFUSED

HOSTILE = (
    "<img src=x onerror=alert(1)>",
    "[win](javascript:alert(1))",
    "![](http://example.com/x.png)",
    "a | b | c",
    "`code` *bold* _em_ ~~gone~~ &lt; # head",
    r"back\slash \<b>",
    "$x$ & <!-- note -->",
)
ASCII = range(128)


class Seen(HTMLParser):
    """The tags and the text that a browser would find."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", ["Logitech C920", "38 mm USB board, M12 lens", "Kamera π (größer)", *ACCEPTED])
def test_a_name_is_printable_and_short(name: str) -> None:
    assert TypeAdapter(Name).validate_python(name) == name


@pytest.mark.parametrize("name", REFUSED)
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Name).validate_python(name)


def test_a_link_is_one_that_robots_take() -> None:
    for link in ("mico_link_hand", "arm/tool-0"):
        assert TypeAdapter(Link).validate_python(link) == link
    for other in {*ACCEPTED, *REFUSED, 'a"/><b', "a--b", "a/", "-a", "mico\n"} - {"null", "W" * LONGEST}:
        with pytest.raises(ValidationError):
            TypeAdapter(Link).validate_python(other)


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("raw_html", [True, False])
def test_markdown_shows_a_name_as_it_is(name: str, raw_html: bool) -> None:
    markdown = MarkdownIt("commonmark", {"html": raw_html}).enable("table").enable("strikethrough")
    line = Seen(markdown.render(f"A device for a {markdown_text(name)}."))
    assert (line.tags, line.text.strip()) == (["p"], f"A device for a {name}.")
    table = Seen(markdown.render(f"| what | note |\n|---|---|\n| {markdown_text(name)} | last |\n"))
    assert table.tags == ["table", "thead", "tr", "th", "th", "tbody", "tr", "td", "td"]
    assert name in table.text
    assert "<img" not in markdown_text(name)


def test_a_plain_name_is_the_same_in_markdown() -> None:
    assert markdown_text("38 mm USB board, M12-lens (6 mm)") == "38 mm USB board, M12-lens (6 mm)"


@pytest.mark.parametrize(
    "name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\uff1d1", "\uff0b1", "\uff0d1", "\uff20A"]
)
def test_no_cell_is_a_formula(name: str) -> None:
    text = StringIO(newline="")
    csv.writer(text).writerow([spreadsheet_text(name), spreadsheet_text(f"a {name}")])
    assert next(csv.reader(StringIO(text.getvalue(), newline=""))) == [f"'{name}", f"a {name}"]


def test_a_word_has_no_blank() -> None:
    assert word("my photo\t1\u00a0.png") == "my_photo_1_.png"
    assert word("Bild_ä.png") == "Bild_ä.png"
    assert word("bad\udcff.png") == "bad_.png"


def test_numbers_stay_numbers_in_yaml() -> None:
    values = [1e-05, -3.25e-17, 1e22, 0.1, -0.0, 1360.38, 5.0]
    read = yaml.safe_load("[" + ", ".join(number(value) for value in values) + "]")
    assert all(type(value) is float for value in read)
    assert read == values
    # What this is about: PyYAML takes Python's own text of the first for a string.
    assert isinstance(yaml.safe_load(repr(values[0])), str)


def test_numbers_read_back_to_the_bit_and_zero_has_no_sign() -> None:
    values = [0.1 + 0.2, -1e-300, 2.0**-1074, 123456789.0, -0.0]
    text = numbers(values, " ")
    assert [float(word) for word in text.split()] == values
    assert text.endswith(" 0.0")


def test_what_the_font_lacks_is_marked() -> None:
    assert drawable("PLA, 20 %", ASCII) == "PLA, 20 %"
    assert drawable("a 鏡\n\udc80", ASCII) == "a \ufffd\ufffd\ufffd"


@pytest.mark.parametrize("text", [*ACCEPTED, *REFUSED])
def test_any_text_fits(text: str) -> None:
    shown = fitted(text, 30.0, len)
    assert shown == (text if len(text) <= 30 else f"{text[:27]}...")
