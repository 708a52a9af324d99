"""A design as files: its request, and what lies in its folder, with a parabola and without one."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.designs.design_files import DesignRequest, read_request, request_of, request_toml, write_design
from mirrorcam.designs.sweep_files import SweepRequest, read_sweep
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances


@pytest.mark.slow
def test_files_hold_what_is_returned(default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = DesignSpec()
    figures = {"metrics": evaluate(default_layout, spec.depths_mm), "verdict": verify(default_layout, spec)}
    layout = default_layout.replaced(spec=spec, **figures)
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls, progress: layout)
    found = write_design(spec, tmp_path)
    assert found.no_parabola == ""
    assert Layout.load(tmp_path / "layout.json") == found.optimised == layout
    assert Layout.load(tmp_path / "parabola.json") == found.parabola
    assert found.parabola is not None
    assert found.parabola.metrics.keys() == layout.metrics.keys()

    def refuse(spec: DesignSpec) -> Layout:
        raise InfeasibleDesign("spacing", "facets do not fit")

    monkeypatch.setattr("mirrorcam.optics.design.optimise.faceted_parabola", refuse)
    found = write_design(spec, tmp_path / "without")
    assert found.parabola is None
    assert "facets do not fit" in found.no_parabola
    written = sorted(path.name for path in (tmp_path / "without").iterdir())
    assert written == ["before_after.png", "focus.png", "layout.json"]


def test_the_layout_is_there_before_any_picture_of_it(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls, progress: layout)

    def broken(*_: object) -> None:
        raise FloatingPointError("no picture")

    monkeypatch.setattr("mirrorcam.designs.design_figure.before_after", broken)
    with pytest.raises(FloatingPointError):
        write_design(DesignSpec(), tmp_path)
    assert Layout.load(tmp_path / "layout.json") == layout
    assert (tmp_path / "parabola.json").exists()


def test_a_pinhole_has_no_figure_of_its_focus(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = DesignSpec(camera=default_layout.camera.replaced(aperture_mm=0.0))
    layout = default_layout.replaced(spec=spec, camera=spec.camera)
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls, progress: layout)
    write_design(spec, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["before_after.png", "layout.json", "parabola.json"]


SPECS = [
    DesignSpec(),
    DesignSpec(rows=1, cols=2, depths_mm=(250.0, 300.0, 900.0), fold_deg="auto", surface="second"),
    DesignSpec(pattern=Pattern.ring(8), camera=Camera.c920().replaced(name='a "name"', body_mm=None)),
]


@pytest.mark.parametrize("spec", SPECS, ids=["default", "rows", "pattern"])
def test_a_request_is_read_as_it_was_written(spec: DesignSpec, tmp_path: Path) -> None:
    path = tmp_path / "design.toml"
    path.write_text(request_toml(spec), encoding="utf-8")
    assert read_request(path).spec == spec
    assert request_of(Path("design.json"), spec.model_dump_json().encode()).spec == spec


def test_a_request_names_a_camera_of_the_library_or_a_file(tmp_path: Path) -> None:
    path = tmp_path / "design.toml"
    path.write_text('camera = "pi_camera_3"\nscale_mm = 70.0\n', encoding="utf-8")
    assert read_request(path).spec == DesignSpec(camera=read_camera("pi_camera_3"), scale_mm=70.0)
    path.write_text('camera = "c920"\n', encoding="utf-8")
    assert request_toml(read_request(path).spec) == request_toml(DesignSpec())
    (tmp_path / "own.json").write_text(Camera.c920().replaced(name="own").model_dump_json(), encoding="utf-8")
    path.write_text(f"camera = '{tmp_path / 'own.json'}'\n", encoding="utf-8")
    assert read_request(path).spec.camera.name == "own"
    path.write_text('camera = "nikon"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"design\.toml: camera: .*camera 'nikon': expected one of .*c920") as caught:
        read_request(path)
    assert "\n" not in str(caught.value)


def test_a_layout_gives_the_request_that_led_to_it(default_layout: Layout, tmp_path: Path) -> None:
    layout = default_layout.replaced(spec=DesignSpec(spacing_mm=1.0))
    layout.save(tmp_path / "layout.json")
    assert read_request(tmp_path / "layout.json").spec == layout.spec


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


def test_the_example_in_the_documents_states_every_default(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "design.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```toml\n(# (?:design|sweep)\.toml\n.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
    for name, block in zip(("design.toml", "sweep.toml"), blocks, strict=True):
        (tmp_path / name).write_text(block, encoding="utf-8")
    assert read_request(tmp_path / "design.toml") == DesignRequest()
    stated = tomllib.loads(blocks[0])
    assert {*stated, "pattern"} == {*DesignRequest.model_fields}
    assert stated["tolerances"].keys() == Tolerances.model_fields.keys()
    assert read_sweep(tmp_path / "sweep.toml") == SweepRequest()
