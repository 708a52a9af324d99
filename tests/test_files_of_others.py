"""No command begins its work where a file of others is in the place of any of its own, or another command works.

Every command runs for real; the slow ones are left out by default.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.sets.video import write_mjpeg
from tests.command_line import assert_one_line
from tests.nightly import a_few
from tests.shared import built_once
from tests.small_set import contents

MINE, STRANGER = b"mine", "thesis.txt"
needs_renderer = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
needs_cad = pytest.mark.skipif(find_spec("build123d") is None, reason="parts need the extra cad")


@dataclass(frozen=True)
class Case:
    """A command that writes into `out`.

    Attributes
    ----------
    work
        Module and name of the function that does its work, which a refused command does not begin.
    forced
        Whether it has an option to replace files of others.
    """

    arguments: str
    work: str
    forced: bool = True


CASES = {
    "design": Case("design --rows 1 --cols 2 --out out", "mirrorcam.designs.design_files:write_design"),
    "sweep": Case("sweep sweep.toml --workers 1 --out out", "mirrorcam.designs.sweep_files:run_local"),
    "board": Case("board --out out/board.svg", "mirrorcam.device.board_files:write_board"),
    "cameras": Case(
        "camera export layout.json --pictures frame.png --out out",
        "mirrorcam.optics.camera_files.write.write_exports:write_exports",
    ),
    "compare": Case(
        "compare layout.json layout.json --distance-mm 400 --out out", "mirrorcam.calibration.comparison:compare_files"
    ),
    "drift": Case(
        "drift frame.png --layout calibrated.json --out out", "mirrorcam.calibration.drift_check:find_drift_files"
    ),
    "render": Case(
        "render layout.json --board board.toml --frames 2 --base-frames 1 --settings avi.toml --workers 1 "
        "--rate-hz 10 --out out",
        "mirrorcam.render_scenes.sets.render_set:write_truth",
        forced=False,
    ),
    "scene": Case(
        "scene layout.json --out out",
        "mirrorcam.render_scenes.tabletop.tabletop_set:TabletopScene",
        forced=False,
    ),
    "decode pictures": Case(
        "decode frame.png --layout layout.json --width-px 32 --equalise white.png --epi --out out",
        "mirrorcam.lightfield.decoding:measure",
    ),
    "decode a video": Case(
        "decode video.avi --layout layout.json --width-px 32 --out out",
        "mirrorcam.lightfield.stream_recording:record",
        forced=False,
    ),
    "refocus": Case(
        "refocus picture.npz --depth-mm 400 --all-in-focus --sweep gif --out out",
        "mirrorcam.lightfield.refocusing:_write_pictures",
    ),
    "depth": Case("depth picture.npz --out out", "mirrorcam.lightfield.depth_maps:DepthEstimator"),
    "features": Case("features picture.npz --out out", "mirrorcam.optics.light_field.features:FeatureFinder"),
    "filter": Case(
        "filter picture.npz --near-mm 300 --far-mm 500 --out out",
        "mirrorcam.optics.light_field.filters:filter_light_field",
    ),
    "track": Case("track picture.npz second.npz --out out", "mirrorcam.optics.light_field.motion:LightFieldTracker"),
    "export": Case(
        "export picture.npz --to hci --out out",
        "mirrorcam.optics.light_field.io.formats.registry:open_light_fields",
    ),
}
RENDERED = ("render", "scene")
SLOW = {
    "run": Case("run --quick --out out", "mirrorcam.run.pipeline:finish"),
    "cad": Case("cad quick/design/layout.json --out out", "mirrorcam.cad.build:build_parts"),
    "picture": Case(
        "cad picture quick/design/layout.json quick/cad --out out/product.jpg",
        "mirrorcam.render_scenes.reference.product_picture:product_picture",
    ),
    "calibrate": Case(
        "calibrate quick/set/frames --base quick/set/base --board quick/set/board.toml "
        "--layout quick/design/layout.json --out out",
        "mirrorcam.calibration.calibration_files:calibrate_files",
    ),
    "validate": Case("validate quick/set --out out", "mirrorcam.calibration.validation:validate"),
}


@pytest.fixture(scope="session")
def inputs(set_request: SetRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands take: the layout of a small sensor, a frame, a video and a light field."""
    return built_once(tmp_path_factory, "inputs", lambda folder: _write_inputs(set_request.layout, set_request, folder))


def _write_inputs(layout: Layout, request: SetRequest, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    layout.save(folder / "layout.json")
    layout.replaced(kind="calibrated").save(folder / "calibrated.json")
    save_board(folder / "board.toml", request.board)
    (folder / "sweep.toml").write_text("counts = [[1, 2]]\nscales_mm = [60]\ntradeoffs = [0.3]\n")
    (folder / "avi.toml").write_text('renderer = "fast"\nvideo = "avi"\n')
    random = np.random.default_rng(0)
    coarse = random.integers(60, 200, (5, 8, 3), dtype=np.uint8)
    size = (layout.camera.width_px, layout.camera.height_px)
    frame = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
    write_image(folder / "frame.png", frame)
    write_image(folder / "frame.jpg", frame)
    write_image(folder / "white.png", np.full_like(frame, 180))
    write_mjpeg(folder / "video.avi", [folder / "frame.jpg"] * 3, 10.0, lambda number: None)
    for name in ("picture", "second"):
        save_npz(folder / f"{name}.npz", Decoder(layout, width_px=32).decode(frame))


@pytest.fixture
def here(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with the inputs."""
    for name, content in contents(inputs).items():
        (tmp_path / name).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(MINE)


def results(folder: Path) -> dict[str, bytes]:
    """Files of a folder without the command's own record of it."""
    return {name: content for name, content in contents(folder).items() if not name.startswith(f"{HIDDEN}/")}


@dataclass(frozen=True)
class Trial:
    """Runs a command whose work must or must not begin, again and again from an empty folder."""

    case: Case
    monkeypatch: pytest.MonkeyPatch
    capture: pytest.CaptureFixture[str]

    def assert_refused(self, out: Path, *expected: str) -> None:
        """The command says in one line one of the expected texts, and leaves everything as it was."""
        before = results(out)
        self.capture.readouterr()
        with self.monkeypatch.context() as patch:
            module, _, function = self.case.work.partition(":")
            patch.setattr(import_module(module), function, _began)
            assert cli.main(self.case.arguments.split()) == 2
        said = self.capture.readouterr().err
        assert_one_line(said)
        assert any(text in said for text in expected), said
        assert results(out) == before

    def done(self, *options: str) -> int:
        code = cli.main([*self.case.arguments.split(), *options])
        said = self.capture.readouterr().err
        assert code in (0, 1), said
        return code


def _began(*arguments: object, **named: object) -> None:
    raise AssertionError("the work began")


@pytest.mark.parametrize(
    "name", a_few(1, [pytest.param(n, marks=needs_renderer if n in RENDERED else ()) for n in CASES])
)
def test_files_of_others_stay(
    name: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert_others_stay(Trial(CASES[name], monkeypatch, capsys), here)


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of `mirrorcam run --quick`."""
    return built_once(tmp_path_factory, "quick", lambda folder: cli.main(["run", "--quick", "--out", str(folder)]))


@pytest.mark.slow
@needs_renderer
@needs_cad
@pytest.mark.parametrize("name", SLOW)
def test_files_of_others_stay_where_the_work_is_long(
    name: str, quick: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(quick, here / "quick")
    assert_others_stay(Trial(SLOW[name], monkeypatch, capsys), here)


def assert_others_stay(trial: Trial, here: Path) -> None:
    """With another command at work, with a file of others in each place, and with all of them and force."""
    out = here / "out"
    with output_folder(out, "other"):
        trial.assert_refused(out, "out: in use by mirrorcam other, process ")
    code = trial.done()
    written = results(out)
    assert written
    shutil.rmtree(out)
    for place in written:
        put(out, place, STRANGER)
        trial.assert_refused(out, f"out/{place.partition('/')[0]}", repr(place))
        shutil.rmtree(out)
    if trial.case.forced:
        put(out, *written, STRANGER)
        assert trial.done("--force") == code
        assert results(out) == written | {STRANGER: MINE}
