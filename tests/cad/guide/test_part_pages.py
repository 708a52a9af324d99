"""A section for each purchased thing, which links lead to, from the guide and from the page."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import manifold3d
from markdown_it import MarkdownIt

from mirrorcam.cad.assembly.bill import bill_of
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import item_title
from mirrorcam.cad.assembly.substitutes import length_notes
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.guide.part_pages import part_pages, with_step_links
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.core.names import anchor_of
from tests.cad.guide.conftest import Made, guide_of


def test_every_link_within_the_guide_leads_to_a_heading(made: Made, tmp_path: Path) -> None:
    guide_of(tmp_path, made.device, made.parts, made.components)
    text = (tmp_path / "guide.md").read_text(encoding="utf-8")
    headings = {anchor_of(re.sub(r"\\(.)", r"\1", line)) for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}
    links = set(re.findall(r"\]\(#([^)]*)\)", text))
    assert len(links) > 10
    # The test's guide has no mirrors in its bill.
    assert {link for link in links if "surface" not in link} <= headings


def test_the_page_has_the_anchors_of_its_links(made: Made) -> None:
    page = (made.folder / "index.html").read_text(encoding="utf-8")
    ids = set(re.findall(r'id="([^"]+)"', page))
    assert {link for link in re.findall(r'href="#([^"]+)"', page) if "surface" not in link} <= ids
    assert "m3-x-10-screw" in ids


def test_every_bought_line_has_a_section_with_source_price_and_step(made: Made) -> None:
    sheets = plan_sheets(made.device.layout, made.device.hardware.cutting)
    bill = bill_of(made.device, made.parts, sheets)
    pages = part_pages(bill, {name: 1 for line in (*bill.bought, *bill.mirrors) for name in line.steps})
    titles = [line.title for line in bill.bought if not line.is_tool]
    assert [page.title for page in pages] == [*titles, *(line.sheet for line in bill.mirrors)]
    for page in pages:
        rows = dict(page.rows)
        assert {"Used for", "Used in", "Search for", "Sold by", "Price"} <= set(rows), page.title
        assert bill.prices_date in rows["Price"]
        assert "[step " in rows["Used in"]
    (screw,) = [dict(page.rows) for page in pages if page.title == "M3 x 10 screw"]
    assert screw["What it is"].startswith("ISO 4762, socket head (shops also say DIN 912)")
    assert screw["Price"].startswith("0.12 EUR, estimated, as of 2026-11; 0.48 EUR for all")


def test_links_to_steps_get_the_anchors_of_their_headings() -> None:
    text = with_step_links("## Step 2: print, cut\n\nsee [step 2](#step-2)\n")
    assert text.endswith("see [step 2](#step-2-print-cut)\n")
    assert '<a href="#step-2-print-cut">' in MarkdownIt("commonmark").render(text)


def test_the_washers_have_space_in_the_device(made: Made) -> None:
    solids = [solid_of(component.mesh) for component in made.components if component.kind in ("part", "camera")]
    solid, screw = manifold3d.Manifold.compose(solids), made.device.hardware.screw
    groups: dict[str, list[PurchasedItem]] = defaultdict(list)
    for bought in purchased_items(made.device):
        if bought.kind == "screw":
            groups[item_title(bought)].append(bought)
    tried = 0
    for items in groups.values():
        found = re.search(r"with (\d+) washer", " ".join(length_notes(items, screw)))
        for bought in items if found else ():
            height = int(found[1]) * screw.washer_height_mm if found else 0.0
            washers = manifold3d.Manifold.cylinder(height, screw.washer_mm / 2.0, circular_segments=48)
            hole = manifold3d.Manifold.cylinder(height, screw.clearance_hole_mm / 2.0, circular_segments=48)
            placed = (washers - hole).translate((0.0, 0.0, 0.02)).transform(bought.rig_from_item[:3])
            assert (placed ^ solid).volume() < 0.01, (item_title(bought), bought.joins)
            tried += 1
    assert tried >= 4
