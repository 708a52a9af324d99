"""`mirrorcam doctor`: installed and missing libraries, and a test of each part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.core.console.progress import say
from mirrorcam.core.console.session import session

if TYPE_CHECKING:
    from mirrorcam.run.installation import Extra, Installation, Package
    from mirrorcam.run.self_tests import SelfTest

TESTED_ON = "Python 3.11, Linux"


def doctor(*, no_tests: Annotated[bool, Parameter(help="skip the tests, which take seconds each")] = False) -> int:
    """List the installed libraries, and test each part.

    Prints the libraries of each extra with the tested versions, missing libraries and their purpose, other programs,
    and a test of each part. Paste the output into a bug report. Exit code 1: an installed part failed its test.

    Examples:
        mirrorcam doctor
        mirrorcam doctor --no-tests --json
    """
    from mirrorcam.run.installation import installation
    from mirrorcam.run.self_tests import parts_to_test, self_tests

    installed = installation()
    _print([*describe(installed)])
    results: list[SelfTest] = []
    for result in () if no_tests else self_tests(parts_to_test(installed)):
        results.append(result)
        verdict = "passed" if result.passed else "FAILED"
        _print([("test", f"{result.name.ljust(10)} {verdict}: {result.said} ({result.seconds:.1f} s)")])
    failed = [result.name for result in results if not result.passed]
    if results:
        _print([("doctor", f"failed: {', '.join(failed)}" if failed else f"{len(results)} parts tested, all work")])
    tests = [result.model_dump(mode="json") for result in results]
    session().results |= installed.model_dump(mode="json") | {"tests": tests}
    return 1 if failed else 0


def _print(lines: Sequence[tuple[str, str]]) -> None:
    """Print lines, unless `--json` replaces them with results of the same content."""
    for title, text in lines if session().prints else ():
        say(title, text)


def describe(installed: Installation) -> list[tuple[str, str]]:
    """Return lines (title, text) about an installation: itself, the libraries of each extra, other programs."""
    lines = [
        ("mirrorcam", f"{installed.version} in {installed.folder}"),
        ("python", f"{installed.python}, {installed.executable}"),
        ("system", installed.system),
        ("versions", f"as installed; where they differ, the tested ones in brackets ({TESTED_ON})"),
    ]
    lines += [(extra.name, _libraries(extra)) for extra in installed.extras]
    lines += [(program.name, program.path or f"not found; for {program.purpose}") for program in installed.programs]
    return lines


def _libraries(extra: Extra) -> str:
    versions = _versions([package for package in extra.packages if package.installed is not None])
    if not extra.missing:
        return versions
    name = f"mirrorcam[{extra.name}]" if extra.name != "base" else "mirrorcam"
    others = f"; installed: {versions}" if versions else ""
    return f'{", ".join(extra.missing)} missing; for {extra.purpose}: pip install "{name}"{others}'


def _versions(packages: Sequence[Package]) -> str:
    return ", ".join(
        f"{package.name} {package.installed}"
        + (f" ({package.tested})" if package.tested not in (None, package.installed) else "")
        for package in packages
    )
