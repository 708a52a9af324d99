"""Requests as files: what is written is read again, and bad ones are refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.designs.design_request import read_request, request_of, request_toml
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

SPECS = [
    DesignSpec(),
    DesignSpec(rows=1, cols=2, depths_mm=(250.0, 300.0, 900.0), fold_deg="auto", surface="second"),
    DesignSpec(pattern=Pattern.ring(8), camera=Camera.c920().replaced(name='a "name"', body_mm=None)),
]


@pytest.mark.parametrize("spec", SPECS, ids=["default", "rows", "pattern"])
def test_a_request_is_read_as_it_was_written(spec: DesignSpec, tmp_path: Path) -> None:
    path = tmp_path / "design.toml"
    path.write_text(request_toml(spec), encoding="utf-8")
    assert read_request(path) == spec
    assert request_of(Path("design.json"), spec.model_dump_json().encode()) == spec


def test_a_request_names_a_camera_of_the_library_or_a_file(tmp_path: Path) -> None:
    path = tmp_path / "design.toml"
    path.write_text('camera = "pi_camera_3"\nscale_mm = 70.0\n', encoding="utf-8")
    assert read_request(path) == DesignSpec(camera=read_camera("pi_camera_3"), scale_mm=70.0)
    path.write_text('camera = "c920"\n', encoding="utf-8")
    assert request_toml(read_request(path)) == request_toml(DesignSpec())
    (tmp_path / "own.json").write_text(Camera.c920().replaced(name="own").model_dump_json(), encoding="utf-8")
    path.write_text(f"camera = '{tmp_path / 'own.json'}'\n", encoding="utf-8")
    assert read_request(path).camera.name == "own"
    path.write_text('camera = "nikon"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"design\.toml: camera: .*camera 'nikon': expected one of .*c920") as caught:
        read_request(path)
    assert "\n" not in str(caught.value)


def test_a_layout_gives_the_request_that_led_to_it(default_layout: Layout, tmp_path: Path) -> None:
    layout = default_layout.replaced(spec=DesignSpec(spacing_mm=1.0))
    layout.save(tmp_path / "layout.json")
    assert read_request(tmp_path / "layout.json") == layout.spec


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.toml", "rows = ", "not valid TOML"),
        ("a.json", "[1]", "a.json"),
        ("a.toml", "rows = 'three'", "rows"),
        ("a.toml", "row = 3", "did you mean rows"),
        ("a.json", '{"mirrors": []}', "a.json"),
    ],
)
def test_what_is_no_request_is_refused_in_one_line(name: str, text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as refused:
        request_of(Path(name), text.encode())
    assert "\n" not in str(refused.value)
