"""Arguments of all public names: any kind of path, and one line for what is wrong with a value or its type."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

import mirrorcam
from mirrorcam.core.arguments import AnyPath
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout

NEEDS = {"build_parts": "build123d"}
"""Names that load something large, and what."""


class OwnPath:
    """A path of a class of somebody else's."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __fspath__(self) -> str:
        return str(self._path)


KINDS: dict[str, Callable[[Path], Any]] = {"str": str, "Path": Path, "PathLike": OwnPath}


def public_callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    """All public functions, and those that public classes define."""
    for name in mirrorcam.__all__:
        public = getattr(mirrorcam, name)
        if not inspect.isclass(public):
            yield name, public
            continue
        for own, _ in inspect.getmembers(public, callable):
            method = inspect.getattr_static(public, own)
            written = getattr(method, "__func__", method)
            ours = inspect.isfunction(written) and written.__module__.startswith("mirrorcam.")
            if ours and (own == "__init__" or not own.startswith("_")) and written.__qualname__ != "Value.__init__":
                yield f"{name}.{own}", public if own == "__init__" else getattr(public, own)


CALLABLES = dict(public_callables())


def results_of(function: Callable[..., Any]) -> Iterator[type]:
    """The classes of this project in the type of what a function returns."""

    def classes(hint: Any) -> Iterator[type]:
        if inspect.isclass(hint) and hint.__module__.startswith("mirrorcam."):
            yield hint
        for each in get_args(hint):
            yield from classes(each)

    # Annotations that only type checkers resolve are names of public classes.
    names = {name: getattr(mirrorcam, name) for name in mirrorcam.__all__}
    hint = inspect.signature(function).return_annotation
    yield from classes(eval(hint, {**function.__globals__, **names}) if isinstance(hint, str) else hint)


def paths_of(function: Callable[..., Any], *annotations: str) -> list[str]:
    """Parameters with one of the annotations; without any, all that name a path."""
    hints = {name: str(each.annotation) for name, each in inspect.signature(function).parameters.items()}
    return [name for name, hint in hints.items() if hint in annotations or (not annotations and "Path" in hint)]


TAKING_PATHS = {
    name: paths for name, function in CALLABLES.items() if (paths := paths_of(function, "AnyPath", "AnyPath | None"))
}
"""The parameters of public functions and methods that are paths."""


@pytest.fixture(scope="module")
def arguments(default_layout: Layout) -> dict[str, Any]:
    """Good arguments by the names of parameters."""
    frame = np.full((default_layout.camera.height_px, default_layout.camera.width_px, 3), 90, dtype=np.uint8)
    return {
        "self": default_layout,
        "layout": default_layout,
        "board": mirrorcam.Checkerboard(rows=6, cols=9, square_mm=20.0),
        "light_field": mirrorcam.Decoder(default_layout, width_px=64).decode(frame),
        "request": mirrorcam.SetRequest(
            layout=default_layout,
            frames=1,
            base_frames=0,
            settings=mirrorcam.RenderSettings(renderer="fast", maps=False),
        ),
        "to": "npz",
        "out": "never_written",
        "frame": frame,
        "folder": "no_set",
        "target": "300g",
        "spec": mirrorcam.DesignSpec(),
        "frames": [],
        "base_frames": [],
        "pictures": [],
    }


def called(name: str, arguments: dict[str, Any], **given: Any) -> Any:
    """Call a public name with an argument, and with good ones for the other parameters that it needs."""
    module = NEEDS.get(name)
    if module is not None and find_spec(module) is None:
        pytest.skip(f"needs {module}")
    function = CALLABLES[name]
    needed = [
        each.name for each in inspect.signature(function).parameters.values() if each.default is inspect.Parameter.empty
    ]
    return function(**({each: arguments[each] for each in needed if each not in given} | given))


def test_every_public_parameter_that_is_a_path_takes_every_path() -> None:
    every = {name: paths for name, function in CALLABLES.items() if (paths := paths_of(function))}
    iterables = {"calibrate": ["frames", "base_frames", "detections"], "calibrate_camera": ["pictures", "detections"]}
    # Methods for the program that writes a set; users read `Dataset.load`.
    of_writer = {f"Dataset.{name}": ["folder"] for name in ("intact", "resumed", "save")}
    of_writer["Dataset.added"] = ["folder", "write"]
    assert every == TAKING_PATHS | iterables | of_writer
    assert {"read_image", "open_light_field", "write_light_field", "render_set", "validate"} <= TAKING_PATHS.keys()
    assert {"Layout.load", "Layout.save", "build_parts", "calibrate"} <= TAKING_PATHS.keys()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in NEEDS else ()) for name in TAKING_PATHS]
)
def test_a_path_that_cannot_be_is_refused_alike_whatever_its_kind(
    name: str, arguments: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("no folder")
    for parameter in TAKING_PATHS[name]:
        given = dict[str, Any]()
        if name == "calibrate":  # a folder of detections is used once there is a picture
            write_image(tmp_path / "a.png", np.zeros((1080, 1920), dtype=np.uint8))
            given = {"frames": [tmp_path / "a.png"]}
        if parameter == "results":  # used once a part is made
            continue
        said = set()
        for kind in KINDS.values():
            with pytest.raises(mirrorcam.InputError) as caught:
                called(name, arguments, **given, **{parameter: kind(tmp_path / "file" / "below.npz")})
            said.add(str(caught.value))
        assert len(said) == 1, said
        assert "\n" not in said.pop()


@pytest.mark.parametrize("name", TAKING_PATHS)
def test_arguments_that_are_not_paths_are_type_errors(name: str, arguments: dict[str, Any]) -> None:
    for parameter in TAKING_PATHS[name]:
        for wrong in (3, b"bytes"):
            with pytest.raises(TypeError, match=rf"^{parameter}: {type(wrong).__name__}, expected str or os.PathLike"):
                called(name, arguments, **{parameter: wrong})


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_files_are_written_and_read_by_any_path(
    kind: Callable[[Path], Any], arguments: dict[str, Any], tmp_path: Path
) -> None:
    layout: Layout = arguments["layout"]
    layout.save(kind(tmp_path / "layout.json"))
    assert mirrorcam.Layout.load(kind(tmp_path / "layout.json")) == layout
    write_image(tmp_path / "a.png", np.full((4, 6), 7, dtype=np.uint8))
    assert (mirrorcam.read_image(kind(tmp_path / "a.png"), grey=True) == 7).all()
    mirrorcam.write_light_field(kind(tmp_path / "a.npz"), arguments["light_field"], "npz")
    light_field = mirrorcam.open_light_field(kind(tmp_path / "a.npz"))
    assert np.array_equal(light_field.samples, arguments["light_field"].samples)
    assert mirrorcam.SetRequest(layout=layout, parts=kind(tmp_path)).parts == tmp_path
    with pytest.raises(mirrorcam.InputError, match=r"a\.png: .*6x4"):
        mirrorcam.calibrate([kind(tmp_path / "a.png")], [], layout, arguments["board"])


VALUES = [
    name
    for name in mirrorcam.__all__
    if inspect.isclass(getattr(mirrorcam, name)) and issubclass(getattr(mirrorcam, name), BaseModel)
]


@pytest.mark.parametrize("name", VALUES)
def test_values_refuse_what_is_wrong_in_one_line(name: str) -> None:
    value = getattr(mirrorcam, name)
    fields = value.model_fields
    tried: list[dict[str, Any]] = [{"nonsense": 1}]
    tried += [{field: wrong} for field in fields for wrong in (object(), "nonsense", -1, float("nan"), [], {"a": 1})]
    refused = 0
    for wrong in tried:
        try:
            value(**wrong)
        except mirrorcam.InputError as error:
            refused += 1
            assert "\n" not in str(error)
            assert 0 < len(str(error)) <= 300
    assert refused > 2 * len(fields)
    for make in (value.model_validate, lambda wrong: value.model_validate_json('{"nonsense": 1}')):
        with pytest.raises(mirrorcam.InputError):
            make({"nonsense": 1})


@pytest.mark.parametrize(
    "make",
    [
        lambda: mirrorcam.DesignSpec(rows=0),
        lambda: mirrorcam.Camera.c920().replaced(fx_px=-1),
        lambda: mirrorcam.Charuco(rows=5, cols=7, square_mm=20.0, marker_mm=30.0),
        lambda: mirrorcam.Layout(rows=1, cols=1, camera=mirrorcam.Camera.c920(), mirrors=()),
        lambda: mirrorcam.RenderSettings(spp=0),
    ],
)
def test_values_that_cannot_be_are_input_errors(make: Callable[[], object]) -> None:
    with pytest.raises(mirrorcam.InputError):
        make()


FIRST = {
    **{"design": "spec", "estimate_depth": "light_field", "render_set": "request", "build_parts": "layout"},
    **{"calibrate": "layout", "write_light_field": "light_field", "Decoder.__init__": "layout"},
}


@pytest.mark.parametrize(("name", "parameter"), FIRST.items())
def test_arguments_of_another_type_are_type_errors_by_name(
    name: str, parameter: str, arguments: dict[str, Any], tmp_path: Path
) -> None:
    function = CALLABLES[name]
    for wrong in ("text", None, 3, object()):
        given = {"out": tmp_path / "out", "path": tmp_path / "a.npz"} | arguments | {parameter: wrong}
        taken = inspect.signature(function).parameters
        with pytest.raises(TypeError, match=f"^{parameter}: {type(wrong).__name__}, expected "):
            function(**{each: value for each, value in given.items() if each in taken})
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_a_calibration_are_an_iterable(arguments: dict[str, Any]) -> None:
    for wrong in ("folder", Path("folder"), 3, None, [3]):
        with pytest.raises(TypeError, match=r"^frames: "):
            mirrorcam.calibrate(wrong, [], arguments["layout"], arguments["board"])  # type: ignore[arg-type]
    for shape in ((4, 4), (4, 4, 3), (2, 40, 40, 3)):
        with pytest.raises(mirrorcam.InputError, match=r"^frames: an array .*, expected a stack \(n, h, w\)"):
            mirrorcam.calibrate(np.zeros(shape, np.uint8), [], arguments["layout"], arguments["board"])
    with pytest.raises(mirrorcam.InputError, match=r"^frames: no pictures given"):
        mirrorcam.calibrate(iter([]), [], arguments["layout"], arguments["board"])


REPORTING = [name for name, function in CALLABLES.items() if "progress" in inspect.signature(function).parameters]


def test_progress_is_a_keyword_everywhere() -> None:
    assert len(REPORTING) == 7
    for name in REPORTING:
        parameters = inspect.signature(CALLABLES[name]).parameters
        assert {parameters[each].kind for each in ("progress", "calls") if each in parameters} == {
            inspect.Parameter.KEYWORD_ONLY
        }


@pytest.mark.parametrize("name", REPORTING)
def test_progress_that_cannot_be_called_is_a_type_error(name: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=r"^progress: NoneType, expected a function$"):
        called(name, arguments, progress=None)


def test_models_of_a_calibration_may_be_words(arguments: dict[str, Any]) -> None:
    needed = {name: arguments[name] for name in ("frames", "base_frames", "layout", "board")}
    with pytest.raises(mirrorcam.InputError, match=r"^unknown word 'wide' of a model"):
        mirrorcam.calibrate(**needed, model="wide")
    with pytest.raises(TypeError, match=r"^model: int, expected str or RequestedModel"):
        mirrorcam.calibrate(**needed, model=3)  # type: ignore[arg-type]


@pytest.mark.parametrize("shape_dtype", [((270, 480), float), ((270, 480, 3), np.uint8), ((270, 480), np.uint16)])
def test_arrays_of_a_calibration_hold_grey_values(shape_dtype: tuple[Any, Any], arguments: dict[str, Any]) -> None:
    wrong = [np.zeros(*shape_dtype)]
    tried: list[tuple[Any, Any]] = [(wrong, []), ([], wrong), (iter(wrong), [])]
    if wrong[0].ndim == 2:
        tried.append((np.stack(wrong), []))
    for frames, base_frames in tried:
        with pytest.raises(mirrorcam.InputError, match=r"^(base_)?frames: an array .*, expected \(h, w\) of uint8"):
            mirrorcam.calibrate(frames, base_frames, arguments["layout"], arguments["board"])


@pytest.mark.parametrize("name", ["a\0b", "a" * 5000])
def test_names_that_no_file_can_have_are_refused(name: str, arguments: dict[str, Any]) -> None:
    for call in (mirrorcam.open_light_field, mirrorcam.read_image, mirrorcam.Layout.load, arguments["layout"].save):
        with pytest.raises(mirrorcam.InputError) as caught:
            call(name)
        assert "\n" not in str(caught.value)


def test_numbers_of_another_type_or_size_are_refused_by_their_name(arguments: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"^near_mm: str, expected int or float"):
        mirrorcam.estimate_depth(arguments["light_field"], near_mm="x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^address: int, expected str"):
        mirrorcam.open_camera(0, 640, 480)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^depth_mm: str, expected ndarray"):
        mirrorcam.write_light_field(tmp_path / "a", arguments["light_field"], "ply", "x")  # type: ignore[arg-type]
    for function, wanted in (
        (mirrorcam.build_parts, "layout out"),
        (mirrorcam.calibrate, "frames base_frames layout board"),
    ):
        needed = {name: arguments[name] for name in wanted.split()}
        with pytest.raises(mirrorcam.InputError, match=r"^workers: 0, expected 1 to 1024$"):
            function(**needed, workers=0)


def test_light_fields_and_formats_that_cannot_be_are_refused(arguments: dict[str, Any], tmp_path: Path) -> None:
    light_field: mirrorcam.LightField = arguments["light_field"]
    with pytest.raises(mirrorcam.InputError, match=r"^to: 'tiff', expected one of "):
        mirrorcam.write_light_field(tmp_path / "a", light_field, "tiff")
    fields = {name: getattr(light_field, name) for name in light_field.__dataclass_fields__}
    for wrong in ({"focal_px": -1.0}, {"positions_mm": [1.0]}, {"reference_depth_mm": float("nan")}):
        with pytest.raises(mirrorcam.InputError):
            mirrorcam.LightField(**fields | wrong)
    with pytest.raises(TypeError, match=r"^samples: list, expected ndarray"):
        mirrorcam.LightField(**fields | {"samples": [1]})
    with pytest.raises(TypeError, match=r"^frame: list, expected ndarray"):
        mirrorcam.Decoder(arguments["layout"]).decode([[1]])  # type: ignore[arg-type]


def test_points_and_pixels_have_their_shape(arguments: dict[str, Any]) -> None:
    layout: Layout = arguments["layout"]
    light_field: mirrorcam.LightField = arguments["light_field"]
    calls: list[tuple[str, int, Callable[[Any], Any]]] = [
        ("points_in_rig", 3, lambda points: layout.project(points, 0)),
        ("points_in_rig", 3, light_field.project),
        ("points_in_view", 3, light_field.project_in_view),
        ("pixels", 2, lambda pixels: layout.shows(pixels, 0)),
        ("pixels", 2, lambda pixels: light_field.plane_points_in_rig(400.0, pixels)),
    ]
    for name, length, call in calls:
        axes = call(np.full((2, 5, length), 300)).shape
        assert 2 <= len(axes) <= 6
        assert call([300.0] * length) is not None
        for wrong in (
            [],
            [300.0],
            np.zeros((length, 5)),
            np.zeros((2, 4)),
            [[1.0] * length, [1.0]],
            1j * np.ones(length),
        ):
            with pytest.raises(mirrorcam.InputError, match=rf"^{name}: .*, expected .*\(\.\.\., {length}\)$"):
                call(wrong)
        for other in (None, "text"):
            with pytest.raises(TypeError, match=rf"^{name}: \w+, expected an array"):
                call(other)


def test_a_mirror_is_an_index_or_a_name(arguments: dict[str, Any]) -> None:
    layout: Layout = arguments["layout"]
    assert np.array_equal(layout.project([0, 400, 0], np.int64(1)), layout.project([0, 400, 0], layout.mirror_names[1]))  # type: ignore[arg-type]
    for wrong in (None, (0, 1), [0], True, 1.0):
        with pytest.raises(TypeError, match=r"^mirror: \w+, expected int or str$"):
            layout.project([0, 400, 0], wrong)  # type: ignore[arg-type]
    for unknown in (-1, 99, "9-9"):
        with pytest.raises(mirrorcam.InputError, match=r"^mirror .*, expected one of "):
            layout.project([0, 400, 0], unknown)


def test_choices_and_counts_of_light_fields_are_refused_by_name(arguments: dict[str, Any]) -> None:
    layout, light_field = arguments["layout"], arguments["light_field"]
    estimator = mirrorcam.DepthEstimator(light_field)
    bare = Layout.bare(layout.camera)
    unacceptable: list[tuple[str, Callable[[], Any]]] = [
        ("field: 'x', expected common or union", lambda: mirrorcam.Decoder(layout, field="x")),  # type: ignore[arg-type]
        ("margin_px: nan", lambda: mirrorcam.Decoder(layout, margin_px=float("nan"))),
        ("layout: a bare camera", lambda: mirrorcam.Decoder(bare)),
        ("quality: 'x', expected best or fast", lambda: mirrorcam.DepthEstimator(light_field, quality="x")),  # type: ignore[arg-type]
        ("workers: 0, expected 1", lambda: mirrorcam.DepthEstimator(light_field, workers=0)),
        ("axis: 'x', expected s or t", lambda: light_field.step_mm("x")),
        ("width_px: -1, expected 1", lambda: mirrorcam.open_camera("0", -1, 1080)),
    ]
    for message, call in unacceptable:
        with pytest.raises(mirrorcam.InputError, match=f"^{message}"):
            call()
    mistyped: list[tuple[str, Callable[[], Any]]] = [
        ("width_px: float, expected int", lambda: mirrorcam.Decoder(layout, width_px=100.5)),  # type: ignore[arg-type]
        ("reference_depth_mm: str", lambda: mirrorcam.Decoder(layout, reference_depth_mm="400")),  # type: ignore[arg-type]
        ("light_field: ndarray, expected LightField", lambda: estimator.estimate(arguments["frame"])),
        ("estimator: LightField, expected Depth", lambda: mirrorcam.VideoDepth(light_field)),
        ("light_field: ndarray", lambda: mirrorcam.VideoDepth(estimator).estimate(arguments["frame"])),
        ("source: str, expected LiveCamera", lambda: mirrorcam.NewestFrame("0")),  # type: ignore[arg-type]
    ]
    for message, call in mistyped:
        with pytest.raises(TypeError, match=f"^{message}"):
            call()


def test_hints_name_both_kinds() -> None:
    assert AnyPath == str | os.PathLike[str]


def test_results_are_of_public_classes() -> None:
    hidden = {
        (name, result.__name__)
        for name, function in CALLABLES.items()
        if inspect.isroutine(function)
        for result in results_of(inspect.unwrap(getattr(function, "__func__", function)))
        if result.__name__ not in mirrorcam.__all__
    }
    # What is known of earlier frames, which only `VideoDepth` passes on.
    assert hidden == {("DepthEstimator.following", "Track")}
