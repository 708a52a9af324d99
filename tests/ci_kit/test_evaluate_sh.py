"""`ci_kit/evaluate.sh`, which action.yml and gitlab.yml run: its settings, exit codes, and a toy that errs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from tests.test_architecture import ROOT

KIT, TOY = ROOT / "ci_kit", ROOT / "examples" / "calibrator_in_ci"
SCRIPT = KIT / "evaluate.sh"
STAND_IN = """#!/bin/sh
printf '%s\\n' "$*" >> "{calls}"
if [ "$1" = suite ] && [ -d "$4" ]; then
    touch "$4/mine.suite.json"
fi
if [ "$1" = score ]; then
    mkdir -p found
    printf 'first\\n![picture](pictures/a.png)\\nlast\\n' > found/summary.md
    exit {code}
fi
"""


def run(folder: Path, code: str = "0", **settings: str) -> tuple[int, list[str]]:
    """The script's exit code, and the calls of a program that stands in for mirrorcam."""
    calls = folder / "calls.txt"
    program = folder / "stand_in"
    program.write_text(STAND_IN.format(calls=calls, code=code), encoding="utf-8")
    program.chmod(0o755)
    environment = {"PATH": os.environ["PATH"], "MIRRORCAM": f"{program}", "OUT": "found"} | settings
    done = subprocess.run(["bash", str(SCRIPT)], cwd=folder, env=environment, capture_output=True, check=False)
    return done.returncode, calls.read_text(encoding="utf-8").splitlines() if calls.exists() else []


def test_it_renders_the_suite_and_evaluates_the_command(tmp_path: Path) -> None:
    assert run(tmp_path, COMMAND="python a.py 'b c'") == (
        0,
        [
            "suite smoke --out mirrorcam-suites",
            "score suite mirrorcam-suites --command python a.py 'b c' --out found --timeout-s 600 --force",
        ],
    )


def test_other_suites_of_the_folder_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    for name in ("mine", "older"):
        (tmp_path / "s" / f"{name}.suite.json").touch()
        os.utime(tmp_path / "s" / f"{name}.suite.json", (1.0, 1.0))
    _, calls = run(tmp_path, COMMAND="x", SUITE="mine.toml", SUITES="s")
    assert calls[1].startswith("score suite s/mine.suite.json --command x ")


def test_settings_become_options(tmp_path: Path) -> None:
    settings = {"LIMITS": "a b.toml", "BASELINE": "b.json", "WORSE_BY": "1.5", "TIMEOUT_S": "9", "FORMAT": "ros"}
    _, calls = run(tmp_path, COMMAND="x", SUITE="standard", SUITES="s", WORKERS="1", SETTINGS="--unit m", **settings)
    assert calls == [
        "suite standard --out s --workers 1",
        "score suite s --command x --out found --timeout-s 9 --force --format ros --limits a b.toml --baseline b.json "
        "--worse-by 1.5 --unit m",
    ]


@pytest.mark.parametrize("code", [0, 1, 2])
def test_the_exit_code_is_that_of_the_evaluation_and_the_summary_goes_to_the_job(tmp_path: Path, code: int) -> None:
    summary = tmp_path / "summary of the job.md"
    summary.write_text("before\n", encoding="utf-8")
    assert run(tmp_path, str(code), COMMAND="x", GITHUB_STEP_SUMMARY=f"{summary}")[0] == code
    assert summary.read_text(encoding="utf-8") == ("before\nfirst\nlast\n" if code < 2 else "before\n")


def test_without_a_command_nothing_is_called(tmp_path: Path) -> None:
    code, calls = run(tmp_path)
    assert code != 0 and calls == []


def test_every_setting_of_action_and_template_is_one_of_the_script() -> None:
    script = SCRIPT.read_text(encoding="utf-8")
    known = set(re.findall(r"\$\{([A-Z_]+):[?+-]", script))
    assert known >= {"COMMAND", "SUITE", "SUITES", "OUT", "FORMAT", "LIMITS", "BASELINE", "WORSE_BY", "TIMEOUT_S"}
    head = script.partition("set -euo")[0]
    assert not {name for name in known - {"GITHUB_STEP_SUMMARY"} if name not in head}
    action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    (step,) = (each for each in action["runs"]["steps"] if each.get("id") == "evaluate")
    assert set(step["env"]) <= known
    used = set(re.findall(r"inputs\.([a-z-]+)", json.dumps(action["runs"])))
    assert used == set(action["inputs"])
    template = yaml.safe_load((KIT / "gitlab.yml").read_text(encoding="utf-8"))[".mirrorcam-evaluation"]
    assert set(template["variables"]) <= known | {"MIRRORCAM_SOURCE", "MIRRORCAM_REF"}
    for text in (json.dumps(action), json.dumps(template)):
        assert "ci_kit/evaluate.sh" in text and "ci_kit/install.sh" in text


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
def test_a_calibrator_made_twice_as_bad_is_told_from_what_it_was(tmp_path: Path) -> None:
    """By a corner rounded to a quarter of a pixel; limits alone tell the same of a lens that is not estimated."""
    program = tmp_path / "mirrorcam"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mirrorcam "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    common = {"SUITE": f"{TOY / 'suite.toml'}", "SUITES": f"{tmp_path / 'suites'}", "LIMITS": f"{TOY / 'limits.toml'}"}

    def evaluated(name: str, **settings: str) -> int:
        environment = os.environ | common | {"MIRRORCAM": f"{program}", "OUT": f"{tmp_path / name}"} | settings
        environment |= {"COMMAND": f'"{sys.executable}" "{TOY / "calibrate.py"}"'}
        return subprocess.run(["bash", str(SCRIPT)], env=environment, check=False).returncode

    assert evaluated("before") == 0
    compared = {"BASELINE": f"{tmp_path / 'before' / 'evaluation.json'}", "WORSE_BY": "1.5"}
    assert evaluated("same", **compared) == 0
    assert evaluated("worse", CORNER_STEP_PX="0.25", **compared) == 1
    changes = json.loads((tmp_path / "worse" / "evaluation.json").read_text(encoding="utf-8"))["changes"]
    factors = [change["now"] / change["before"] for change in changes]
    assert len(factors) == 2 and all(1.5 < factor < 3.0 for factor in factors)
