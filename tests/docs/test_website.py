"""The documentation site: gathered whole, every link leads somewhere, and every page is fit to be read in a browser."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote, urlsplit

import pytest

import mirrorcam
from docs.website.accessible import accessible
from docs.website.api_pages import GROUPS
from docs.website.command_pages import FOLDER, command_pages, commands
from docs.website.gather import ROOT, gather, outside_code, page_of
from mirrorcam.cli import NAMES, application
from tests.shared import built_once
from tests.studio.browser import browser_page

WIDE, NARROW = (1280, 900), (390, 844)
TOY = "<!doctype html><title>A stand-in for the studio</title><h1>Studio</h1>"


class Page(HTMLParser):
    """What a page links to, what it loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag in ("a", "area") and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon"):
            self.loads.append(given["href"])
        elif "src" in given:
            self.loads.append(given["src"])


def dead_links(folder: Path) -> list[str]:
    """Links of all pages in a folder that lead to no file or no anchor, or have no sensible address."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    dead = []
    for path, page in pages.items():
        for link in page.links:
            address = urlsplit(link)
            to = (path.parent / unquote(address.path)).resolve() if address.path else path
            to = to / "index.html" if to.is_dir() else to
            if address.scheme:
                good = address.scheme in ("http", "https") and re.fullmatch(r"[\w.-]+\.\w+", address.netloc) is not None
            elif to in pages and address.fragment:
                good = unquote(address.fragment) in pages[to].anchors
            else:
                good = to.is_file() and to.is_relative_to(folder)
            if not good:
                dead.append(f"{path.relative_to(folder)}: {link}")
    return dead


def test_a_file_has_its_place_on_the_site() -> None:
    assert page_of("docs/tour.md") == "tour"
    assert page_of("docs/guides/maker.md") == "guides/maker"
    assert page_of("docs/website/pages/index.md") == "index"
    assert page_of("CONTRIBUTING.md") == "contributing"
    assert page_of("examples/decode_video.py") == "repository/examples/decode_video.py"


def test_code_is_left_as_it_is() -> None:
    text = "a\n\n```sh\na\n```\n\na\n\n:::{only} a\na\n:::\n"
    assert outside_code(text, lambda part: part.replace("a", "b")) == (
        "b\n\n```sh\na\n```\n\nb\n\n:::{only} b\nb\n:::\n"
    )


def test_links_to_the_repository_become_pages(tmp_path: Path) -> None:
    gather(tmp_path, {"reference/names": "# Names\n"})
    assert "(repository/examples/decode_video.py.md)" in (tmp_path / "library.md").read_text(encoding="utf-8")
    assert "](measured.md)" in (tmp_path / "theory.md").read_text(encoding="utf-8")
    assert "[](conventions.md)" in (tmp_path / "design_method.md").read_text(encoding="utf-8")
    shown = (tmp_path / "repository/examples/decode_video.py.md").read_text(encoding="utf-8")
    assert (ROOT / "examples/decode_video.py").read_text(encoding="utf-8").rstrip() in shown
    listed = (tmp_path / "repository/optics/geometry/cameras.md").read_text(encoding="utf-8")
    assert "[c920.toml](cameras/c920.toml.md)" in listed
    assert (tmp_path / "repository/optics/geometry/cameras/c920.toml.md").is_file()
    assert not (tmp_path / "README.md").exists()


def test_parameters_on_lines_of_their_own_are_no_definitions() -> None:
    given = '<dt class="sig py"><dl>\n<dd>a</dd>\n</dl></dt><dl><dd>b</dd></dl><pre>c</pre>'
    assert accessible(given) == (
        '<dt class="sig py"><span class="sig-lines">\n<span class="sig-line">a</span>\n</span></dt><dl><dd>b</dd></dl>'
        '<pre tabindex="0">c</pre>'
    )


def test_cells_of_a_table_with_many_columns_carry_their_headings() -> None:
    def table(columns: int) -> str:
        head = "".join(
            f'<th class="head"><p>{name}</p></th>' for name in ("a", "b &lt; <em>c</em>", "d", "e")[:columns]
        )
        row = "<tr><td><p>1</p></td><td></td>" + '<td class="x"><p>3</p></td>' * (columns - 2) + "</tr>"
        return f'<table class="docutils"><thead><tr>{head}</tr></thead><tbody>{row}</tbody></table>'

    assert accessible(table(3)) == table(3)
    shown = accessible(table(4))
    assert shown.startswith('<table class="labelled docutils"><thead>')
    assert re.findall(r"<td[^>]*>", shown) == [
        '<td data-label="a">',
        '<td data-label="b &lt; c">',
        '<td data-label="d" class="x">',
        '<td data-label="e" class="x">',
    ]


def test_the_text_of_a_parameter_is_not_a_type() -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    from docs.website.docstrings import with_text_below

    text = ["A b.", "", "Parameters", "----------", "a : of the glass.", "b : int", "    How many."]
    assert with_text_below(text) == [*text[:4], "a", "    of the glass.", *text[5:]]


def test_every_command_and_option_is_in_the_reference() -> None:
    pages = command_pages()
    assert set(pages) == {f"{FOLDER}/index", *(f"{FOLDER}/{name}" for name in NAMES)}
    for words, command in commands(application()).items():
        name = words.split()[0]
        page = pages[f"{FOLDER}/{name}"]
        assert f"[mirrorcam {name}]({name}.md)" in pages[f"{FOLDER}/index"]
        assert f"# mirrorcam {words}\n" in page
        written = set(re.findall(r"`(--[a-z][a-z0-9-]+)[ `,]", page))
        options = command.assemble_argument_collection() if command.default_command is not None else ()
        assert {each.name for each in options if each.name[:2] == "--"} <= written
        assert not [option for option in written if option.startswith(("--no-force", "--empty-"))]
    assert "```sh\nmirrorcam sweep\n" in pages[f"{FOLDER}/sweep"]
    assert "([design](../../design.md))" in pages[f"{FOLDER}/sweep"]


def test_every_public_name_is_in_the_reference() -> None:
    names = [name for names in GROUPS.values() for name in names]
    assert sorted(names) == sorted(mirrorcam.__all__)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as the command builds it, with a stand-in for the studio's snapshot."""
    pytest.importorskip("sphinx", reason="the extra docs is not installed")

    def build(folder: Path) -> None:
        folder.mkdir()
        (folder / "toy.html").write_text(TOY, encoding="utf-8")
        for name in ("index.html", "nine/files/nine.zip", ".mirrorcam/lock"):
            (folder / "gallery" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "gallery" / name).write_text(TOY, encoding="utf-8")
        command = [sys.executable, "-m", "docs.website", str(folder / "site")]
        command += ["--toy", str(folder / "toy.html"), "--devices", str(folder / "gallery")]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
        assert done.returncode == 0, done.stderr[-3000:]
        assert done.stderr == ""

    return built_once(tmp_path_factory, "documentation_site", build) / "site"


def test_a_foreign_folder_is_not_a_site(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    from docs.website.__main__ import main

    (tmp_path / "thesis.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(SystemExit, match="2"):
        main([str(tmp_path)])
    assert "nor an earlier site" in capsys.readouterr().err
    assert (tmp_path / "thesis.txt").is_file()


@pytest.mark.parametrize("option", ["--toy", "--devices"])
def test_what_lies_in_the_site_is_not_lost_with_it(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    from docs.website.__main__ import main

    (tmp_path / "mine").mkdir()
    for name in ("searchindex.js", "mine/index.html"):
        (tmp_path / name).touch()
    with pytest.raises(SystemExit, match="2"):
        main([str(tmp_path), option, str(tmp_path / "mine")])
    assert f"mine: expected a path outside {tmp_path}, which is replaced" in capsys.readouterr().err
    assert (tmp_path / "mine/index.html").is_file()


def test_what_is_not_there_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    from docs.website import __main__ as command

    ran: list[list[str]] = []
    monkeypatch.setattr(subprocess, "run", lambda line, check: ran.append(line))
    monkeypatch.setattr(command, "build", lambda out, toy, devices: 0)
    toy = tmp_path / "studio.html"
    gallery = tmp_path / "gallery"
    assert command.main([str(tmp_path / "site"), "--toy", str(toy), "--devices", str(gallery)]) == 0
    assert [line[1:] for line in ran] == [
        ["-m", "mirrorcam", "studio", "--snapshot", str(toy)],
        ["-m", "docs.gallery", str(gallery)],
    ]


def read_pages(site: Path) -> list[str]:
    """The pages that are written to be read, not copies of files of the repository."""
    every = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    apart = ("repository/", "toy", "devices/", "genindex", "search", "_static")
    return [name for name in every if not name.startswith(apart)]


@pytest.mark.slow
def test_every_link_of_the_site_leads_somewhere(site: Path) -> None:
    assert dead_links(site) == []
    assert len(read_pages(site)) > 50


def test_dead_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<p id="x"><a href="a.html#x"><a href="#y"><a href="b.html"><a href="https://c">')
    assert dead_links(tmp_path) == ["a.html: #y", "a.html: b.html", "a.html: https://c"]


@pytest.mark.slow
def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for path in site.rglob("*.html"):
        loads = Page(path.read_text(encoding="utf-8")).loads
        assert [load for load in loads if urlsplit(load).scheme not in ("", "data")] == []


@pytest.mark.slow
def test_formulas_are_drawn_by_the_browser_and_fields_are_described(site: Path) -> None:
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math") > 30
    assert "$" not in re.sub(r"<(script|style).*?</\1>", "", theory, flags=re.DOTALL)
    names = (site / "reference" / "names.html").read_text(encoding="utf-8")
    fields = re.sub(r"<[^>]+>", "", names)
    description = "distance from the pupil to the central mirror, along the optical axis, 0.001 to 100000, default 80.0"
    assert re.search(rf"scale_mm \(float\) . {re.escape(description)}", fields)
    assert "TypeAliasForwardRef" not in names
    assert " at 0x" not in names


@pytest.mark.slow
def test_the_front_page_has_the_toy(site: Path) -> None:
    assert (site / "toy.html").read_text(encoding="utf-8") == TOY
    front = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="toy.html"' in front
    assert "Try it here (0.0 MB)" in front


@pytest.mark.slow
def test_the_gallery_is_on_the_site(site: Path) -> None:
    for page in ("index.html", "gallery.html"):
        assert (site / page).read_text(encoding="utf-8").count('href="devices/index.html"') == 1
    assert (site / "devices/nine/files/nine.zip").read_text(encoding="utf-8") == TOY
    assert not (site / "devices/.mirrorcam").exists()


TABLES = (
    "[...document.querySelectorAll('article table')].filter((t) => t.scrollWidth > t.parentElement.clientWidth).length"
)
BROKEN = "[...document.images].filter((i) => i.complete && !i.naturalWidth).map((i) => i.src)"


@pytest.mark.slow
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_every_page_fits_and_shows_its_pictures(flat_browser: Any, site: Path, size: tuple[int, int]) -> None:
    with browser_page(flat_browser, size) as watched:
        found = []
        for name in read_pages(site):
            watched.page.goto((site / name).as_uri())
            wider = watched.page.evaluate("document.documentElement.scrollWidth - innerWidth")
            broken = watched.page.evaluate(BROKEN)
            # On a wide screen, tables with a dozen columns scroll.
            wide_tables = watched.page.evaluate(TABLES) if size == NARROW else 0
            if wider > 0 or broken or wide_tables:
                found.append((name, wider, broken, wide_tables))
        assert found == []
        assert watched.errors == []


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_page_is_accessible(flat_browser: Any, site: Path, scheme: Literal["light", "dark"]) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    found = {}
    with browser_page(flat_browser, WIDE, scheme) as watched:
        for name in read_pages(site):
            watched.page.goto((site / name).as_uri())
            violations = axe.Axe().run(watched.page).response["violations"]
            if violations:
                found[name] = [(each["id"], [node["html"][:120] for node in each["nodes"][:3]]) for each in violations]
    assert found == {}


@pytest.mark.slow
def test_the_toy_begins_where_its_picture_was(flat_browser: Any, site: Path) -> None:
    with browser_page(flat_browser) as watched:
        watched.page.goto((site / "index.html").as_uri())
        watched.page.click(".toy-start")
        frame = watched.page.frame_locator(".toy iframe")
        assert frame.locator("h1").inner_text() == "Studio"
        assert watched.page.locator(".toy-picture").count() == 0
        assert watched.errors == []


@pytest.mark.slow
def test_the_search_finds_an_option(flat_browser: Any, site: Path) -> None:
    with browser_page(flat_browser) as watched:
        watched.page.goto((site / "search.html").as_uri() + "?q=mounting")
        # Results come one by one.
        watched.page.wait_for_selector("#search-results li a:has-text('mirrorcam run')")
        results = watched.page.locator("#search-results li a").all_inner_texts()
        assert any("mirrorcam run" in text for text in results)


@pytest.mark.slow
def test_all_pages_are_a_sequence(site: Path) -> None:
    """Every page of the contents links the one before and the one after it."""
    forth: dict[str, str] = {}
    back: dict[str, str] = {}
    for name in read_pages(site):
        text = (site / name).read_text(encoding="utf-8")
        for rel, found in (("next", forth), ("prev", back)):
            if link := re.search(rf'<link rel="{rel}" [^>]*href="([^"#]+)', text):
                found[name] = ((site / name).parent / link[1]).resolve().relative_to(site.resolve()).as_posix()
    assert {after: name for name, after in forth.items()} == back
    page, visited = "index.html", ["index.html"]
    while page in forth:
        page = forth[page]
        visited.append(page)
    assert set(visited) == set(read_pages(site))
