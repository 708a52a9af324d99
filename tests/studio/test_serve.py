"""The studio serves on the loopback address alone, and ends cleanly on Ctrl-C."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.designs.design_files import request_toml
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.serve import opened

FROM_TERMINAL = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "


@pytest.mark.slow
def test_it_ends_on_ctrl_c_with_all_its_processes(tmp_path: Path) -> None:
    run = f"{FROM_TERMINAL} from mirrorcam.cli import main; sys.exit(main({['studio', '--no-browser', '--port', '0']}))"
    process = subprocess.Popen(
        [sys.executable, "-c", run], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert process.stdout is not None
    address = process.stdout.readline().split()[1]
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address) as answer:
        assert b"MirrorCam studio" in answer.read()
    children = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(process.pid)], capture_output=True, text=True, check=True
    )
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "ended" in out
    assert err == ""
    for _ in range(100):  # the process that workers are copies of ends once it notices
        left = [child for child in children.stdout.split() if alive(int(child))]
        if not left:
            break
        time.sleep(0.1)
    assert left == []
    assert list(tmp_path.iterdir()) == []


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_a_port_that_is_taken_is_refused(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "mirrorcam", "studio", "--no-browser", "--port", str(port)]
        found = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 2
    assert f"--port {port}" in found.stderr
    assert found.stderr.count("\n") == 1


def test_a_request_and_a_layout_are_opened(default_layout: Layout, tmp_path: Path) -> None:
    assert opened(None).spec == DesignSpec()
    request = tmp_path / "design.toml"
    request.write_text(request_toml(DesignSpec(rows=2)))
    assert opened(request).spec == DesignSpec(rows=2)
    assert opened(request).layout is None
    assert opened("http://127.0.0.1:8610/#tab=build&rows=2").fragment == "tab=build&rows=2"
    layout = default_layout.replaced(spec=DesignSpec())
    layout.save(tmp_path / "layout.json")
    assert opened(tmp_path / "layout.json").spec == DesignSpec()
    default_layout.replaced(spec=None).save(tmp_path / "bare.json")
    with pytest.raises(InputError, match="without its request"):
        opened(tmp_path / "bare.json")
    with pytest.raises(InputError, match="no solved design"):
        opened(tmp_path)
