"""`mirrorcam doctor`: what is installed, what is missing for what, and whether each part works."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.core.console.progress import say
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.run.installation import Extra, Installation, Package
    from mirrorcam.run.self_tests import SelfTest

TESTED_ON = "Python 3.11, Linux"


class DoctorOptions(Value):
    """Say what is installed, what is missing for what, and which versions were tested, then try each part.

    Put what it prints into a report of an error. Exit code 1: a part that is installed failed its test.
    """

    as_json: Annotated[bool, tyro.conf.arg(name="json")] = Field(
        default=False, description="print everything as one JSON object instead, after the tests"
    )
    no_tests: bool = Field(default=False, description="leave the tests out, which take some seconds each")


def run(options: DoctorOptions) -> int:
    """Print what is installed and the results of the tests."""
    from mirrorcam.run.installation import installation
    from mirrorcam.run.self_tests import parts_to_test, self_tests

    found = installation()
    if not options.as_json:
        for title, text in described(found):
            say(title, text)
    results: list[SelfTest] = []
    for result in () if options.no_tests else self_tests(parts_to_test(found)):
        results.append(result)
        if not options.as_json:
            say("test", f"{result.name.ljust(10)} {'passed' if result.passed else 'FAILED'}: {_timed(result)}")
    failed = [result.name for result in results if not result.passed]
    if options.as_json:
        tests = [result.model_dump(mode="json") for result in results]
        print(json.dumps(found.model_dump(mode="json") | {"tests": tests}, indent=1))
    elif results:
        say("doctor", f"failed: {', '.join(failed)}" if failed else f"{len(results)} parts tried, all work")
    return 1 if failed else 0


def _timed(result: SelfTest) -> str:
    return f"{result.said} ({result.seconds:.1f} s)"


def described(found: Installation) -> list[tuple[str, str]]:
    """Lines (title, text) about an installation: itself, the libraries of each extra, other programs."""
    lines = [
        ("mirrorcam", f"{found.version} in {found.folder}"),
        ("python", f"{found.python}, {found.executable}"),
        ("system", found.system),
        ("versions", f"as installed; in brackets those that were tested ({TESTED_ON}), where they differ"),
    ]
    lines += [(extra.name, _libraries(extra)) for extra in found.extras]
    lines += [(each.name, each.path or f"not found; for {each.purpose}") for each in found.programs]
    return lines


def _libraries(extra: Extra) -> str:
    versions = _versions([package for package in extra.packages if package.installed is not None])
    if not extra.missing:
        return versions
    name = f"mirrorcam[{extra.name}]" if extra.name != "base" else "mirrorcam"
    has = f"; there is {versions}" if versions else ""
    return f'{", ".join(extra.missing)} missing; for {extra.purpose}: pip install "{name}"{has}'


def _versions(packages: Sequence[Package]) -> str:
    return ", ".join(
        f"{each.name} {each.installed}" + (f" ({each.tested})" if each.tested not in (None, each.installed) else "")
        for each in packages
    )
