"""Prices: found by the longest name, replaced by a file, known for everything that devices of the library need."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import item_title
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.goods import AREA, GOODS, PIECE
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prices import OTHER_PLASTIC, PLASTICS, Prices, hours_text, summary_of
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

PRICES = Prices()


def test_the_longest_name_at_an_end_of_a_title_counts() -> None:
    assert PRICES.of_plastic("PLA+ matt black", 1000.0) == PLASTICS["PLA"]
    assert PRICES.of_plastic("PETG", 500.0) == PLASTICS["PETG"] / 2.0
    assert PRICES.of_plastic("Unobtainium", 1000.0) == OTHER_PLASTIC
    assert PRICES.of_item("M3 x 12 countersunk screw") == GOODS["countersunk screw"].eur["M3"]
    assert PRICES.of_item("M3 x 5.7 heat-set insert") == GOODS["heat-set insert"].eur["M3"]
    assert PRICES.of_item("0.4 x 5 x 12 compression spring") == GOODS["compression spring"].eur[""]
    assert PRICES.of_item("a tool of gold") is None
    glass = GOODS["second-surface glass mirror"]
    assert PRICES.of_mirrors("second-surface glass mirror, 2 mm", 250.0) == 2.5 * glass.eur[AREA]
    assert PRICES.of_mirror_pieces("second-surface glass mirror, 2 mm", 10) == 10 * glass.eur[PIECE]
    own = PRICES.replaced(mirror_each={"second-surface glass mirror": 0.1})
    assert own.of_mirror_pieces("second-surface glass mirror, 2 mm", 10) == 1.0
    with pytest.raises(ValueError, match="stock paper"):
        PRICES.of_mirrors("paper", 1.0)


def test_a_file_replaces_prices_and_comes_back_the_same(tmp_path: Path) -> None:
    path = tmp_path / "prices.toml"
    path.write_text('date = "2027-01"\n[each]\n"M3 screw" = 0.02\n[plastic_per_kg]\n"PLA+" = 31\n')
    prices = read_model(Prices, path)
    assert prices.of_item("M3 x 8 screw") == 0.02
    assert prices.of_item("M3 x 8 countersunk screw") == GOODS["countersunk screw"].eur["M3"]
    assert (prices.of_plastic("PLA+", 1000.0), prices.of_plastic("PLA", 1000.0)) == (31.0, PLASTICS["PLA"])
    path.write_text(tomli_w.dumps(prices.model_dump(mode="json")))
    assert read_model(Prices, path) == prices
    # Devices are cached by their hardware.
    assert hash(prices) == hash(read_model(Prices, path))


@pytest.mark.parametrize("text", ["[each]\nM3 = -1.0\n", '[each]\nM3 = "dear"\n', "each = 3\n", "shipping = 5\n"])
def test_an_invalid_price_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "prices.toml").write_text(text)
    with pytest.raises(InputError):
        read_model(Prices, tmp_path / "prices.toml")


def test_every_bought_item_of_any_back_has_a_price(device: Device) -> None:
    for kind in BACKS:
        hardware = device.hardware.replaced(back=back_of(kind))
        carried = replace(device, hardware=hardware, back=plan_back(device.clip, device.mount, hardware))
        assert [title for title in map(item_title, purchased_items(carried)) if PRICES.of_item(title) is None] == []


@pytest.mark.slow
def test_every_item_for_mirrors_on_screws_has_a_price(device: Device) -> None:
    hardware = device.hardware.replaced(holder=device.hardware.holder.replaced(mirrors="screws"))
    titles = {item_title(each) for each in purchased_items(plan_device(device.layout, hardware))}
    assert any("spring" in title for title in titles)
    assert [title for title in titles if PRICES.of_item(title) is None] == []


def test_all_cameras_of_the_library_but_phones_have_a_price() -> None:
    names = {name: read_body(name).name for name in camera_names()}
    assert {name for name, title in names.items() if PRICES.of_item(title) is None} == {
        "galaxy_s21",
        "iphone_13",
        "pixel_7",
    }
    assert HARDWARE.prices == PRICES


def test_a_device_is_summarised_in_one_line() -> None:
    figures = {
        "device.mass_g": Metric(value=392.4, unit="g"),
        "device.price": Metric(value=117.6, unit="EUR"),
        "device.print_minutes": Metric(value=150.8, unit="min"),
    }
    assert summary_of(figures) == "392 g, about 118 EUR, 2:31 h of printing"
    assert summary_of({}) == ""
    assert (hours_text(None), hours_text(65.0)) == ("-", "1:05 h")
