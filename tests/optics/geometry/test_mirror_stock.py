"""Names of mirror stock, and the material of a layout's mirrors."""

from __future__ import annotations

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import material_of, stock_fields


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
