"""The code and libraries that a result depends on: modules with all their imports.

Sources are parsed, not imported. Comments, docstrings and imports for type checkers do not count.
"""

from __future__ import annotations

import ast
import re
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from mirrorcam.core.disk.fingerprint import digest, file_digest

PACKAGE = "mirrorcam"
NOT_INSTALLED = "not installed"
_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[([^\]]*)\])?[^;]*(?:;(.*))?")
_PARSING = threading.Lock()
"""Python before 3.11.8 raises SystemError if two threads build syntax trees at once (python/cpython#106905)."""
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def program_of(*modules: str) -> dict[str, str]:
    """Return the dependencies of modules' results: the digest of their `code`, and versions of libraries by name.

    The libraries are those that this code imports, and the compiled ones that these require: they can change the
    results of an unchanged library.
    """
    return {"code": code_digest(*modules)} | _versions(*modules)


@cache
def code_digest(*modules: str) -> str:
    """Return the sha256 of modules and all modules of the same package that they import, directly or not.

    All imports count, also those in functions, and so do strings with the name of a module, as in
    `import_module("mirrorcam.cad.build")`. Data files that a module reads count, see `_data_files`. Raises
    ModuleNotFoundError for a missing module.
    """
    return digest(*(f"{name} {source.sha256}\n".encode() for name, source in sorted(_closure(modules).items())))


def modules_of(*modules: str) -> frozenset[str]:
    """Return the names of the modules that `code_digest` covers."""
    return frozenset(_closure(modules))


@dataclass(frozen=True)
class _Source:
    """A module: digest of its effective code, and names of the modules and libraries that it imports."""

    sha256: str
    modules: frozenset[str]
    libraries: frozenset[str]


@cache
def _closure(modules: tuple[str, ...]) -> dict[str, _Source]:
    sources: dict[str, _Source] = {}
    pending = list(modules)
    while pending:
        name = pending.pop()
        if name not in sources:
            sources[name] = _source(name)
            pending += sources[name].modules
    return sources


@cache
def _source(module: str) -> _Source:
    path = _path_of(module)
    if path is None:
        raise ModuleNotFoundError(f"no module {module!r} to compute the digest of")
    with _PARSING:
        tree = ast.parse(path.read_bytes())
    tree.body = _effective(tree.body)
    nodes = list(ast.walk(tree))
    strings = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    variables = {node.id for node in nodes if isinstance(node, ast.Name)}
    imported = set(_imported(nodes, module if path.name == "__init__.py" else module.rpartition(".")[0]))
    top = module.partition(".")[0]
    modules = {name for name in imported | strings if name.startswith(f"{top}.")}
    if "iter_modules" in variables:  # it imports all modules of its folder
        modules |= {f"{module.rpartition('.')[0]}.{sibling.stem}" for sibling in path.parent.glob("*.py")}
    # Importing a module runs its parent packages; the top package only names its public modules.
    names = {
        ".".join(parts[:count]) for parts in (name.split(".") for name in modules) for count in range(2, len(parts) + 1)
    }
    attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    folders = [path.parent, *([path.parents[1]] if "parents" in attributes else [])]
    data = _data_files(folders, strings) if "__file__" in variables else []
    parts = [ast.dump(tree, annotate_fields=False), *(f"{file.name} {file_digest(file)}" for file in data)]
    libraries = {name.partition(".")[0] for name in imported} - sys.stdlib_module_names - {top}
    existing = frozenset(name for name in names if _path_of(name))
    return _Source(digest("\n".join(parts).encode()), existing, frozenset(libraries))


def _effective(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return statements without docstrings and blocks for type checkers."""
    effective: list[ast.stmt] = []
    for statement in body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue
        for inner in (statement, *getattr(statement, "handlers", ()), *getattr(statement, "cases", ())):
            for name in ("body", "orelse", "finalbody"):
                if isinstance(block := getattr(inner, name, None), list):
                    setattr(inner, name, _effective(block))
        if isinstance(statement, ast.If) and ast.unparse(statement.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            effective += statement.orelse
        else:
            effective.append(statement)
    return effective


def _imported(nodes: list[ast.AST], package: str) -> Iterator[str]:
    """Yield names that import statements may load; for `from a import b`, both `a` and `a.b`."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _data_files(folders: list[Path], strings: set[str]) -> list[Path]:
    """Return the data files of a module that uses `__file__`: those in its folder, and those named in its strings."""
    names = [text for text in strings if re.fullmatch(r"\w[\w.]*", text)]
    named = [path for folder in folders for name in names for path in [folder / name, *(folder / name).rglob("*")]]
    return sorted({file for file in (*folders[0].iterdir(), *named) if file.is_file() and file.suffix[:3] != ".py"})


@cache
def _path_of(module: str) -> Path | None:
    """Return the path of a module's source, or None."""
    top, *inner = module.split(".")
    folders = (spec.submodule_search_locations or ()) if (spec := find_spec(top)) else ()
    for base in (Path(folder, *inner) for folder in folders):
        for path in (base / "__init__.py", base.with_name(f"{base.name}.py")):
            if path.is_file():
                return path
    return None


@cache
def _versions(*modules: str) -> dict[str, str]:
    libraries = {name for source in _closure(modules).values() for name in source.libraries}
    direct = {name for library in libraries for name in _distributions_of(library)}
    distributions, pending = set(direct), list(direct)
    while pending:
        pending += (new := required(pending.pop(), frozenset()) - distributions)
        distributions |= new
    return {name: version(name) for name in sorted(distributions) if name in direct or _is_compiled(name)}


@cache
def _distributions_of(library: str) -> tuple[str, ...]:
    """Return the distributions that provide an importable library; its own name if none is installed."""
    if version(library) != NOT_INSTALLED:
        return (normalised(library),)
    return tuple(map(normalised, _packages().get(library, [library])))


@cache
def _packages() -> Mapping[str, list[str]]:
    return metadata.packages_distributions()


def version(distribution: str) -> str:
    """Return the installed version of a distribution, or `NOT_INSTALLED`."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return NOT_INSTALLED


def required(distribution: str, extras: frozenset[str]) -> set[str]:
    """Return the requirements of a distribution with some of its extras; platform conditions count as met."""
    try:
        lines = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return set()
    requirements = set()
    for line in lines:
        match = _REQUIREMENT.match(line)
        assert match is not None, line
        name, inner, condition = match.groups()
        only_with = set(_EXTRA.findall(condition or ""))
        if only_with and not only_with & extras:
            continue
        if normalised(name) == normalised(distribution):  # an extra made of other extras
            requirements |= required(distribution, frozenset(name.strip() for name in inner.split(",")))
        else:
            requirements.add(normalised(name))
    return requirements


def normalised(name: str) -> str:
    """Return the canonical spelling of a distribution's name."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _is_compiled(distribution: str) -> bool:
    try:
        wheel = metadata.distribution(distribution).read_text("WHEEL")
    except metadata.PackageNotFoundError:
        return False
    return wheel is not None and "root-is-purelib: false" in wheel.lower()
