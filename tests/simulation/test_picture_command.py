"""`mirrorcam picture`: refusals; what it draws is tested with `render_scenes.reference.product_picture`."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cli import BAD_INPUT, main

LAYOUT = Path(__file__).parents[1] / "data" / "default_layout.json"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "product.gif"], "--out product.gif: expected a name that ends in .png, .jpg, .jpeg"),
        (["--parts", "nowhere"], "nowhere: no assembly.glb, expected a folder that `mirrorcam cad` wrote"),
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
    assert main(["picture", str(LAYOUT), *arguments]) == BAD_INPUT
    assert capsys.readouterr().err.strip().splitlines() == [f"mirrorcam: {message}"]
    assert list(tmp_path.iterdir()) == []
