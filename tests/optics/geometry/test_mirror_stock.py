"""Names of mirror stock, and the material of a layout's mirrors."""

from __future__ import annotations

import re

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import material_of, narrowest, stock_fields, too_narrow


def test_a_name_gives_the_fields_of_a_design() -> None:
    spec = DesignSpec().replaced(**stock_fields("second-glass-3"))
    assert (spec.surface, spec.thickness_mm, spec.refractive_index) == ("second", 3.0, 1.52)
    assert DesignSpec().replaced(**stock_fields("first-glass-3")) == DesignSpec()


@pytest.mark.parametrize("name", ["glass", "second-steel-2", "third-glass-2", "second-glass-0", "second-glass-3 mm"])
def test_other_names_are_refused_with_examples(name: str) -> None:
    with pytest.raises(InputError, match=f"mirror stock {name}: expected .* second-glass-2"):
        stock_fields(name)


@pytest.mark.parametrize(("name", "material"), [("first-glass-3", "glass"), ("second-acrylic-2", "acrylic")])
def test_the_material_is_that_of_the_refractive_index(default_layout: Layout, name: str, material: str) -> None:
    index = stock_fields(name)["refractive_index"]
    mirrors = tuple(mirror.replaced(refractive_index=index) for mirror in default_layout.mirrors)
    assert material_of(default_layout.replaced(mirrors=mirrors)) == material


def test_a_mirror_too_narrow_for_its_glass_names_stock_and_a_scale_that_fit(default_layout: Layout) -> None:
    assert too_narrow(default_layout) == ""
    assert narrowest(default_layout) > 1.0
    thick = default_layout.replaced(mirrors=tuple(m.replaced(thickness_mm=6.0) for m in default_layout.mirrors))
    assert re.search(
        r"mirror \d-\d is 1\d\.\d+ mm across, expected at least 4 times its thickness, 24 mm: design with "
        r"--mirror first-glass-3 or --mirror first-acrylic-1 or --scale-mm 1\d\d$",
        too_narrow(thick),
    )
    assert narrowest(thick) == pytest.approx(narrowest(default_layout) / 2.0)
