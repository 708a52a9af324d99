"""The store of results: what was made of the same is not made again, whatever kills, damage and others do to it."""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from mirrorcam.core.disk import program, results
from mirrorcam.core.disk.program import code_digest, modules_of, program_of
from mirrorcam.core.disk.results import Results
from mirrorcam.core.errors import InputError

MADE_OF = {"picture": "a" * 64, "size": "3", "numpy": "2.1"}
CONTENTS = {"b": b"\x00\n{}", "a": b"", "parts/x": b"x" * 1000}


def test_what_was_kept_comes_back(tmp_path: Path) -> None:
    store = Results(tmp_path / "results")
    assert store.get("name", MADE_OF) is None
    assert store.difference("name", MADE_OF) == "not made yet"
    store.put("name", MADE_OF, CONTENTS)
    assert store.get("name", MADE_OF) == CONTENTS
    assert store.difference("name", MADE_OF) == ""
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["name"]


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"picture": "b" * 64}, "picture changed"),
        ({"size": "4"}, "size 3 → 4"),
        ({"numpy": "2.2"}, "numpy 2.1 → 2.2"),
        ({"slicer": "2.9"}, "slicer not installed → 2.9"),
    ],
)
def test_another_input_option_or_version_makes_another_result(
    other: dict[str, str], words: str, tmp_path: Path
) -> None:
    store, now = Results(tmp_path), MADE_OF | other
    store.put("name", MADE_OF, CONTENTS)
    assert store.get("name", now) is None
    assert store.difference("name", now) == words
    store.put("name", now, {"new": b"new"})
    assert store.get("name", now) == {"new": b"new"}
    assert store.get("name", MADE_OF) is None


def test_damaged_results_are_replaced(tmp_path: Path) -> None:
    store = Results(tmp_path)
    store.put("name", MADE_OF, CONTENTS)
    whole = (tmp_path / "name").read_bytes()
    line = whole.index(b"\n")
    for damaged in (whole[:-1], whole[: line + 1], whole[: line - 5], whole[:-1] + b"y"):
        (tmp_path / "name").write_bytes(damaged)
        assert store.get("name", MADE_OF) is None
        store.put("name", MADE_OF, CONTENTS)
        assert (tmp_path / "name").read_bytes() == whole


def test_foreign_files_are_neither_used_nor_replaced(tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "thesis")
    store = Results(tmp_path)
    for name in ("file", "folder", "link"):
        store.put(name, MADE_OF, CONTENTS)
        assert store.get(name, MADE_OF) is None
    assert (tmp_path / "file").read_text() == (tmp_path / "thesis").read_text() == "mine"
    assert (tmp_path / "link").is_symlink()
    for name in ("../out", "/etc/out"):
        with pytest.raises(InputError, match="expected the name of a file in this folder"):
            store.put(name, MADE_OF, CONTENTS)
    (tmp_path / "elsewhere").symlink_to(tmp_path / "folder")
    for name, what in (("elsewhere", "link"), ("file", "file")):
        with pytest.raises(InputError, match=f"{name}: is a {what}, expected a folder for results"):
            Results(tmp_path / name)


def test_a_result_that_is_too_large_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "LARGEST_FILE_BYTES", 1000)
    Results(tmp_path).put("name", MADE_OF, CONTENTS)
    assert list(tmp_path.iterdir()) == []


PUTS = """
import sys
from pathlib import Path
from mirrorcam.core.disk.results import Results
store = Results(Path(sys.argv[1]))
print("begins", flush=True)
while True:
    store.put("name", {"by": sys.argv[2]}, {"content": sys.argv[2].encode() * 1_000_000})
"""


def test_two_killed_processes_leave_complete_results(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    command = [sys.executable, "-c", PUTS, str(folder)]
    writing = [subprocess.Popen([*command, by], stdout=subprocess.PIPE, text=True) for by in "12"]
    try:
        for process in writing:
            assert process.stdout is not None
            assert process.stdout.readline() == "begins\n"
        store, read = Results(folder), 0
        while read < 50:
            found = [contents for by in "12" if (contents := store.get("name", {"by": by})) is not None]
            read += len(found)
            assert all(
                set(contents["content"]) < set(b"12") and len(contents["content"]) == 10**6 for contents in found
            )
    finally:
        for process in writing:
            process.send_signal(signal.SIGKILL)
            process.communicate()
    assert sum(store.get("name", {"by": by}) is not None for by in "12") == 1
    store.put("name", MADE_OF, CONTENTS)
    assert store.get("name", MADE_OF) == CONTENTS


MODULES = {
    "__init__": "from made_up.offers import nothing",
    "work": '''"""Docstring."""
from typing import TYPE_CHECKING
from . import beside
from .deep.used import f
import numpy.linalg, pydantic
if TYPE_CHECKING:
    from made_up import types_only
TABLE = __file__, "table.toml", "tables"
def g():
    """Docstring."""
    import made_up.late
    return import_module("made_up.by_name")
''',
    "beside": "x = 1",
    "late": "x = 1",
    "by_name": "x = 1",
    "deep/__init__": "y = 1",
    "deep/used": "from made_up.deep import other\nf = 1",
    "deep/other": "import made_up.work",
    "types_only": "x = 1",
    "unrelated": "import made_up.work",
    "offers": "nothing = 1",
}


@pytest.fixture
def made_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a package of made-up modules, of which `work` is the one that makes results."""
    folder = tmp_path / "made_up"
    for name, text in MODULES.items():
        (folder / f"{name}.py").parent.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.py").write_text(text)
    (folder / "table.toml").write_text("a = 1")
    (folder / "tables").mkdir()
    (folder / "tables" / "b.toml").write_text("b = 1")
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def digest_now() -> str:
    """The digest of `made_up.work` as in a new process."""
    for each in (code_digest, program._closure, program._source, program._path_of, program._versions):
        each.cache_clear()
    return code_digest("made_up.work")


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


@pytest.mark.parametrize("name", ["work", "beside", "late", "by_name", "deep/__init__", "deep/used", "deep/other"])
def test_changed_code_of_what_a_module_imports_makes_another_result(name: str, made_up: Path) -> None:
    before = digest_now()
    (made_up / f"{name}.py").write_text(MODULES[name] + "\nz = 2")
    assert digest_now() != before


@pytest.mark.parametrize("name", ["table.toml", "tables/b.toml"])
def test_changed_data_that_a_module_reads_makes_another_result(name: str, made_up: Path) -> None:
    before = digest_now()
    (made_up / name).write_text("a = 2")
    assert digest_now() != before


@pytest.mark.parametrize("name", ["types_only", "unrelated", "offers", "__init__"])
def test_code_that_a_module_does_not_run_changes_no_result(name: str, made_up: Path) -> None:
    before = digest_now()
    (made_up / f"{name}.py").write_text("changed = True")
    (made_up / "__pycache__").mkdir()
    (made_up / "__pycache__" / "work.pyc").write_bytes(b"0")
    assert digest_now() == before


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("x = 1", "x = 1  # a comment"),
        ("x = 1", '"""A docstring."""\n\nx = 1\n"""What x is."""'),
        ("x = 1", "if typing.TYPE_CHECKING:\n    import ast\nx = 1"),
    ],
)
def test_comments_docstrings_and_imports_for_type_checkers_change_no_result(
    before: str, after: str, made_up: Path
) -> None:
    digest = digest_now()
    edit(made_up / "beside.py", before, after)
    edit(made_up / "work.py", '"""Docstring."""', '"""Another."""')
    edit(made_up / "work.py", '    """Docstring."""', "    # now a comment")
    assert digest_now() == digest


def test_a_module_that_is_not_there_has_no_digest() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"no module 'mirrorcam\.nonsense'"):
        code_digest("mirrorcam.nonsense")


def test_versions_are_those_of_the_libraries_that_the_code_imports(
    made_up: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digest_now()
    found = program_of("made_up.work")
    assert found.keys() == {"code", "numpy", "pydantic", "pydantic-core"}
    assert found["numpy"] == metadata.version("numpy")
    now = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "999" if name == "pydantic-core" else now(name))
    digest_now()
    assert program_of("made_up.work") == found | {"pydantic-core": "999"}
    assert "opencv-contrib-python-headless" in program_of("mirrorcam.core.images.pictures")


USERS = [
    "mirrorcam.optics.calibration.detection.detect_boards",
    "mirrorcam.optics.design.optimise",
    "mirrorcam.cad.device_files",
    "mirrorcam.render_scenes.sets.render_set",
]


@pytest.mark.slow
@pytest.mark.parametrize("module", USERS)
def test_every_module_that_is_loaded_counts(module: str) -> None:
    code = f"import sys, {module}; print(*(name for name in sys.modules if name.startswith('mirrorcam.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    if "is not installed" in done.stderr or "ModuleNotFoundError" in done.stderr:
        pytest.skip(done.stderr.splitlines()[-1])
    assert set(done.stdout.split()) <= modules_of(module)


def test_found_corners_depend_on_no_exporter_and_designs_on_no_calibration() -> None:
    unrelated = {
        USERS[0]: ("mirrorcam.optics.camera_files", "mirrorcam.optics.light_field", "mirrorcam.optics.design"),
        USERS[1]: ("mirrorcam.optics.calibration", "mirrorcam.optics.light_field", "mirrorcam.render_scenes"),
    }
    for module, others in unrelated.items():
        assert not [name for name in modules_of(module) if name.startswith(others)]


@pytest.mark.parametrize(
    ("line", "extras", "found"),
    [
        ("numpy>=2,<3", (), {"numpy"}),
        ("OpenEXR>=3.4; extra == 'render'", (), set()),
        ("OpenEXR>=3.4; extra == 'render'", ("render",), {"openexr"}),
        ('py_lib.x[more]>=1; sys_platform == "linux" and extra == "cad"', ("cad",), {"py-lib-x"}),
        ('tzdata; sys_platform == "win32"', (), {"tzdata"}),
    ],
)
def test_requirements_are_read_with_their_extras(
    line: str, extras: tuple[str, ...], found: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metadata, "requires", lambda name: [line])
    assert program.required("some", frozenset(extras)) == found
