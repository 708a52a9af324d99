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


def doctor(*, no_tests: Annotated[bool, Parameter(help="skip the tests, which take some seconds each")] = False) -> int:
    """List the installed libraries, and test each part.

    Prints the libraries of each extra with the tested versions, the missing ones and what needs them, other programs,
    and a test of each part. Paste it into a bug report. Exit code 1: an installed part failed its test.

    Examples:
        mirrorcam doctor
        mirrorcam doctor --no-tests --json
    """
    from mirrorcam.run.installation import installation
    from mirrorcam.run.self_tests import parts_to_test, self_tests

    found = installation()
    _print([*described(found)])
    results: list[SelfTest] = []
    for result in () if no_tests else self_tests(parts_to_test(found)):
        results.append(result)
        verdict = "passed" if result.passed else "FAILED"
        _print([("test", f"{result.name.ljust(10)} {verdict}: {result.said} ({result.seconds:.1f} s)")])
    failed = [result.name for result in results if not result.passed]
    if results:
        _print([("doctor", f"failed: {', '.join(failed)}" if failed else f"{len(results)} parts tested, all work")])
    session().results |= found.model_dump(mode="json") | {"tests": [each.model_dump(mode="json") for each in results]}
    return 1 if failed else 0


def _print(lines: Sequence[tuple[str, str]]) -> None:
    """Print lines, unless `--json` replaces them: its results hold the same content."""
    for title, text in lines if session().prints else ():
        say(title, text)


def described(found: Installation) -> list[tuple[str, str]]:
    """Lines (title, text) about an installation: itself, the libraries of each extra, other programs."""
    lines = [
        ("mirrorcam", f"{found.version} in {found.folder}"),
        ("python", f"{found.python}, {found.executable}"),
        ("system", found.system),
        ("versions", f"as installed; in brackets the tested ones ({TESTED_ON}), where they differ"),
    ]
    lines += [(extra.name, _libraries(extra)) for extra in found.extras]
    lines += [(each.name, each.path or f"not found; for {each.purpose}") for each in found.programs]
    return lines


def _libraries(extra: Extra) -> str:
    versions = _versions([package for package in extra.packages if package.installed is not None])
    if not extra.missing:
        return versions
    name = f"mirrorcam[{extra.name}]" if extra.name != "base" else "mirrorcam"
    installed = f"; installed: {versions}" if versions else ""
    return f'{", ".join(extra.missing)} missing; for {extra.purpose}: pip install "{name}"{installed}'


def _versions(packages: Sequence[Package]) -> str:
    return ", ".join(
        f"{each.name} {each.installed}" + (f" ({each.tested})" if each.tested not in (None, each.installed) else "")
        for each in packages
    )
