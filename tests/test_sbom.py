"""`.ci/sbom`: it refuses a list that lacks what is installed, and the real one lists what the lock does."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from tests.test_architecture import ROOT

# In the place of the environment from the lock, this one; in the place of the tool, a list made here.
PYTHON = """#!/bin/sh
case "$2" in
venv) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
pip) ;;
*) exec "{python}" "$@" ;;
esac
"""
TOOL = """#!/bin/sh
for each; do last=$each; done
cp "{listed}" "$last"
"""


def program(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


def sbom(out: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    command = ["bash", str(ROOT / ".ci" / "sbom"), str(out)]
    return subprocess.run(command, env=os.environ | settings, capture_output=True, text=True, check=False)


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
def test_a_list_that_lacks_a_package_is_refused(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-I", "-c", INSTALLED], capture_output=True, text=True, check=True)
    installed = json.loads(done.stdout)
    assert "numpy" in [each["name"] for each in installed]
    program(tmp_path / "python", PYTHON.format(python=sys.executable))
    program(tmp_path / "cyclonedx-py", TOOL.format(listed=tmp_path / "listed.json"))
    settings = {"PYTHON": str(tmp_path / "python"), "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    for listed, code in ((installed, 0), ([each for each in installed if each["name"] != "numpy"], 1)):
        (tmp_path / "listed.json").write_text(json.dumps({"components": listed}), encoding="utf-8")
        out = tmp_path / f"{code}.json"
        done = sbom(out, **settings)
        assert done.returncode == code, done.stderr
        assert out.exists() == (code == 0)
    assert done.stderr.strip() == f"not listed: [('numpy', '{metadata.version('numpy')}')]"


INSTALLED = """
import json
from importlib import metadata
print(json.dumps([{"name": each.name, "version": each.version} for each in metadata.distributions()]))
"""


@pytest.mark.slow
def test_the_bill_lists_what_the_lock_does_and_keeps_its_schema(tmp_path: Path) -> None:
    if shutil.which("cyclonedx-py") is None:
        pytest.skip("needs cyclonedx-py (pip install cyclonedx-bom, in an environment of its own)")
    done = sbom(tmp_path / "bom.json")
    if re.search("Could not find a version|connection|resolve", done.stderr):
        pytest.skip(f"the packages of requirements.lock cannot be fetched: {done.stderr.strip()[-200:]}")
    assert done.returncode == 0, done.stderr[-2000:]
    bill: dict[str, Any] = json.loads((tmp_path / "bom.json").read_text(encoding="utf-8"))
    assert (bill["bomFormat"], bill["metadata"]["component"]["name"]) == ("CycloneDX", "mirrorcam")
    listed = {re.sub(r"[-_.]+", "-", f"{each['name']}=={each['version']}".lower()) for each in bill["components"]}
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    needed = {re.sub(r"[-_.]+", "-", line.split()[0].lower()) for line in lock if "==" in line and ";" not in line}
    assert needed <= listed
