"""Choosing the variant never ends the process."""

from __future__ import annotations

import importlib.util
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.render_scenes import variant


@pytest.fixture
def afresh() -> Iterator[None]:
    """Clear the cached findings of this process, before and after."""
    for each in (True, False):
        for found in (variant.usable_library, variant.choose_variant, variant._check_usable):
            found.cache_clear()
        if each:
            yield


def run_python(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != variant.LIBRARY_VARIABLE} | variables
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


RENDERS = """
from mirrorcam.render_scenes.variant import use_variant
from mirrorcam.core.errors import InputError
try:
    print(use_variant())
except InputError as error:
    raise SystemExit(f"refused: {error}")
import drjit as dr
import mitsuba as mi
print(dr.minimum(dr.sqrt(mi.Float([4, 16, 25])), 4))
"""


def test_a_fresh_process_finds_a_fast_variant_and_renders() -> None:
    done = run_python(RENDERS)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0] in (variant.LLVM, variant.CUDA)
    assert done.stdout.split("\n")[1] == "[2, 4, 4]"


def test_an_unusable_library_of_the_user_is_refused_in_one_line(tmp_path: Path) -> None:
    broken = tmp_path / "libLLVM.so"
    broken.write_bytes(b"no library")
    done = run_python(RENDERS, **{variant.LIBRARY_VARIABLE: str(broken)})
    if not variant.has_gpu():
        assert done.returncode == 1
        assert done.stderr.startswith(f"refused: {variant.LIBRARY_VARIABLE}={broken}")
        assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_an_llvm_that_aborts_never_aborts_us() -> None:
    old = [p for v in (15, 16) for p in sorted(Path("/usr/lib").glob(f"*/libLLVM-{v}.so*"))]
    if not old:
        pytest.skip("no LLVM 15 or 16 on this machine")
    assert not variant.can_render(variant.LLVM, old[0])
    done = run_python(RENDERS, **{variant.LIBRARY_VARIABLE: str(old[0])})
    assert done.returncode in (0, 1), done.stderr
    # Another library imported Dr.Jit first, which loaded that LLVM.
    done = run_python("import drjit\n" + RENDERS, **{variant.LIBRARY_VARIABLE: str(old[0])})
    assert done.returncode in (0, 1), done.stderr


def test_drjit_imported_before_with_an_old_llvm_is_refused(afresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    import drjit as dr

    monkeypatch.setattr(dr.detail, "llvm_version", lambda: (15, 0, 6))
    with pytest.raises(InputError, match=r"drjit was imported with LLVM 15\.0\.6, too old"):
        variant.use_variant(variant.LLVM)


def test_the_packaged_library_is_found_by_its_real_name() -> None:
    library = variant.packaged_library()
    assert library is not None
    assert library.is_file()
    assert not library.is_symlink()


@pytest.mark.skipif(sys.platform != "linux", reason="the package of LLVM is for Linux")
def test_the_library_loads_before_its_links_exist(tmp_path: Path) -> None:
    library = variant.packaged_library()
    assert library is not None
    shutil.copy(library, tmp_path / library.name)
    runtime = next(library.parent.glob("*/libc++.so.1.0")).parent
    (tmp_path / runtime.name).mkdir()
    for name in ("libc++.so.1.0", "libc++abi.so.1.0", "libunwind.so.1.0"):
        shutil.copy(runtime / name, tmp_path / runtime.name / name)
    load = f"import ctypes; ctypes.CDLL({str(tmp_path / library.name)!r})"
    assert run_python(load).returncode != 0  # the pitfall is real
    ours = "import pathlib; from mirrorcam.render_scenes.variant import can_load;  "
    ours += f"print(can_load(pathlib.Path({str(tmp_path / library.name)!r})))"
    assert run_python(ours).stdout == "True\n"


def test_a_missing_library_does_not_load(tmp_path: Path) -> None:
    assert not variant.can_load(tmp_path / "libLLVM.so.99")


def test_without_any_llvm_it_falls_back_and_says_so_once(
    afresh: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(variant, "has_gpu", lambda: False)
    monkeypatch.setattr(variant, "usable_library", lambda: None)
    with caplog.at_level(logging.WARNING):
        assert variant.choose_variant() == variant.SCALAR
        assert variant.choose_variant() == variant.SCALAR
    assert len(caplog.messages) == 1
    assert "pip install" in caplog.messages[0]
    assert "\n" not in caplog.messages[0]
    with pytest.raises(InputError, match="needs an LLVM: pip install"):
        variant.use_variant(variant.LLVM)


def test_a_missing_mitsuba_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "mitsuba" else find(name))
    with pytest.raises(InputError, match=r'pip install "mirrorcam\[render\]"'):
        variant.use_variant()


def test_in_colour_it_is_the_same_kind_with_three_channels() -> None:
    grey = variant.use_variant()
    assert variant.use_variant(colour=True) == grey.replace("_mono", "_rgb")
    assert variant.use_variant() == grey


def test_an_unknown_variant_is_refused() -> None:
    with pytest.raises(InputError, match="variant 'llvm_rgb' is unknown"):
        variant.use_variant("llvm_rgb")


def test_cuda_is_refused_where_no_gpu_answers(afresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "has_gpu", lambda: False)
    with pytest.raises(InputError, match="needs a GPU"):
        variant.use_variant(variant.CUDA)
