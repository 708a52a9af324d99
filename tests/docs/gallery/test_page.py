"""The page of the gallery: a card for each device, in any order, which escapes what it is given and works offline."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from docs.gallery.page import NBSP, ORDERS, GalleryCard, gallery_html
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES
from mirrorcam.core.images.pictures import write_image
from tests.docs.gallery.gallery_cards import CARDS, NINE, TWO
from tests.run.test_run_page import Outline, outline
from tests.studio.browser import NARROW, browser_page

pytestmark = pytest.mark.slow

PICTURE_PX = (1280, 720)
DESKTOP = (1280, 900)


def page(*cards: GalleryCard) -> str:
    return gallery_html(cards, PICTURE_PX, command="python -m docs.gallery")


def read(*cards: GalleryCard) -> Outline:
    return outline(page(*cards))


def test_each_card_leads_to_the_files_of_its_device_and_nothing_outside() -> None:
    targets = read(*CARDS).targets
    for card in CARDS:
        assert {
            f"{card.name}/cad/index.html",
            f"{card.name}/cad/guide.md",
            f"{card.name}/design/layout.json",
            f"{card.name}/files/{card.name}.zip",
            f"{card.name}/picture/device.jpg",
        } <= {*targets}
    assert all(target.split("/")[0] in {card.name for card in CARDS} for target in targets)
    assert not re.search(r"https?://|@import|url\(", page(*CARDS))


def test_a_card_says_what_was_measured() -> None:
    facts = dict(NINE.facts)
    assert facts["Views"] == f"3 {TIMES} 3, 9 mirrors"
    assert facts["Size"].replace(NBSP, " ") == f"101 {TIMES} 214 {TIMES} 130 mm"
    assert facts["Printing"] == "17:57 h"
    assert facts["Seen by all views"] == "69% to 64%"
    assert facts[f"{SIGMA} of depth"].replace(NBSP, " ") == "0.089 mm at 300 mm; 0.17 mm at 500 mm"
    text = read(*CARDS).text
    assert all(text_of in text for card in CARDS for _, text_of in card.facts)
    assert "Three light field cameras to print" in text
    assert "160 to 184 each" in text


def test_what_is_not_known_is_not_invented() -> None:
    bare = NINE.replaced(
        print_minutes=None,
        focus_mm=None,
        at_depths=tuple(at.replaced(usable_efficiency=None) for at in NINE.at_depths),
    )
    facts = dict(bare.facts)
    assert facts["Printing"] == "unknown"
    assert not {"Focus locked at", "Usable by the full pupil"} & facts.keys()
    missing = "Times of printing are missing"
    assert missing not in read(*CARDS).text
    assert f"{missing}: PrusaSlicer" in read(bare).text
    assert f"{missing} for {bare.title}: PrusaSlicer" in read(bare, TWO).text


def test_texts_of_others_are_escaped() -> None:
    evil = '<script>alert("x")</script>'
    bad = NINE.replaced(title=evil, purpose=evil, camera=evil, mount=f'"{evil}', views=evil, mirrors=evil)
    made = page(bad)
    assert evil not in made
    assert made.count("<script>") == page(NINE).count("<script>") == 1


def test_cards_have_the_figures_that_they_are_ordered_by() -> None:
    assert set(NINE.order) == {name for name, _ in ORDERS}
    for name, value in TWO.order.items():
        assert f'data-{name}="{value}"' in page(TWO)


@pytest.fixture
def gallery(tmp_path: Path) -> str:
    for card in CARDS:
        write_image(tmp_path / card.picture, np.full((720, 1280, 3), 90, np.uint8))
    (tmp_path / "index.html").write_text(page(*CARDS), encoding="utf-8")
    return (tmp_path / "index.html").as_uri()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, NARROW], ids=["wide", "narrow"])
def test_it_is_accessible_and_no_wider_than_its_window(
    browser: Any, gallery: str, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with browser_page(browser, size, scheme) as watched:
        watched.open(gallery)
        assert watched.page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        for fold in watched.page.locator("summary").all():
            fold.click()
        found = axe.Axe().run(watched.page).response["violations"]
        assert [(each["id"], [node["html"][:120] for node in each["nodes"][:3]]) for each in found] == []
        assert watched.errors == []
        assert watched.outside == []


def test_cards_can_be_ordered_and_chosen(browser: Any, gallery: str) -> None:
    with browser_page(browser, DESKTOP, "light") as watched:
        watched.open(gallery)

        def shown() -> list[str]:
            cards = watched.page.locator(".cards > li:visible").all()
            return [card.get_attribute("id") or "" for card in cards]

        assert shown() == ["nine-views", "two-views", "seven-views"]
        watched.page.select_option("[name=order]", "price")
        assert shown() == ["two-views", "nine-views", "seven-views"]
        watched.page.select_option("[name=mount]", "a tripod")
        assert shown() == ["two-views", "seven-views"]
        watched.page.select_option("[name=count]", "7")
        assert shown() == ["seven-views"]
        assert watched.page.inner_text("output") == "1 of 3 devices"
        watched.page.select_option("[name=mount]", "a desk, or a tripod")
        assert shown() == []
        watched.page.select_option("[name=count]", "")
        watched.page.select_option("[name=mount]", "")
        watched.page.select_option("[name=order]", "")
        assert shown() == ["nine-views", "two-views", "seven-views"]
        assert watched.errors == []
