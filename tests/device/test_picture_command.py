"""`mirrorcam cad picture`: refusals; what it draws is tested with `render_scenes.reference.product`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import BAD_INPUT, main
from mirrorcam.core.images.pictures import read_image
from mirrorcam.render_scenes.reference import product_picture

LAYOUT = Path(__file__).parents[1] / "data" / "default_layout.json"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cad", "--out", "product.gif"], "--out product.gif: expected a name that ends in .png, .jpg, .jpeg"),
        (["nowhere"], "nowhere: no assembly.glb, expected a folder that `mirrorcam cad` wrote"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["cad", "picture", str(LAYOUT), *arguments]) == BAD_INPUT
    assert capsys.readouterr().err.strip().splitlines() == [f"mirrorcam: {message}"]
    assert list(tmp_path.iterdir()) == []


def test_it_is_written_in_the_format_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = np.repeat(np.tile(np.arange(60, dtype=np.uint8), (40, 1))[..., None], 3, axis=2)
    monkeypatch.setattr(product_picture, "product_picture", lambda layout, folder, spp: picture)
    for name, error in (("device.png", 0), ("device.JPG", 2)):
        path = tmp_path / name
        assert main(["cad", "picture", str(LAYOUT), str(tmp_path), "--out", str(path)]) == 0
        assert np.abs(read_image(path).astype(int) - picture).max() <= error
