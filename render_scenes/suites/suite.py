"""Suites: named, versioned lists of recipes, of the program or in a user's TOML file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import PICTURES, Bounds
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, inside, model_from, read_bytes, tables_of
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import Line
from mirrorcam.core.values import InputError, Value, with_tuples
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.recipe import SetRecipe, Slug

SUITES = Path(__file__).parent
VERSION = Bounds(1, 1_000_000)


class Suite(Value):
    """A suite: what its file states, `[defaults]` put into each `[[set]]` that does not state the same.

    Parameters
    ----------
    name
        Its name, which its results carry.
    version
        Number that is raised when its sets change, so that figures of one version compare.
    description
        What it is for.
    recipes
        Its sets, each or many of a kind as one recipe; in a file `[[set]]`.
    """

    name: Slug
    version: int = VERSION.field()
    description: Line = ""
    recipes: tuple[SetRecipe, ...] = Field(alias="set", min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("set"), list | tuple):
            return data
        defaults = data.get("defaults", {})
        if not isinstance(defaults, dict) or "name" in defaults:
            raise ValueError("defaults: expected a table without a name")
        sets = [defaults | each if isinstance(each, dict) else each for each in data["set"]]
        others = {name: value for name, value in data.items() if name not in ("defaults", "set")}
        return others | {"set": with_tuples(sets)}

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = sum(recipe.copies for recipe in self.recipes)
        if count > PICTURES.most:
            raise ValueError(f"{count} sets, expected {PICTURES.most} or fewer")
        names = [recipe.name for recipe in self.sets]
        if len(set(names)) < len(names):
            twice = next(name for number, name in enumerate(names) if name in names[:number])
            raise ValueError(f"set: the name {twice} appears twice")
        return self

    def times(self, copies: int) -> Self:
        """The suite with so many copies of each set, which differ in their seeds alone; one is the suite itself."""
        if copies == 1:
            return self
        recipes = tuple(recipe.replaced(copies=recipe.copies * copies) for recipe in self.recipes)
        return self.replaced(name=f"{self.name}-x{copies}", recipes=recipes)

    @property
    def sets(self) -> tuple[SetRecipe, ...]:
        """A recipe for each set."""
        return tuple(one for recipe in self.recipes for one in recipe.expanded())


def suite_names() -> tuple[str, ...]:
    """Names of the suites that come with the program."""
    return tuple(sorted(path.stem for path in SUITES.glob("*.toml")))


def read_suite(name: str) -> Suite:
    """A suite of the program by its name, or that of a TOML file, whose layouts are files beside it.

    Raises InputError in one line for a name that is not known, and a file or a recipe that is not valid.
    """
    if name in suite_names():
        return _read(SUITES / f"{name}.toml")
    if not name.lower().endswith(".toml"):
        raise InputError(f"suite {shortened(name, 40)!r}: expected one of {', '.join(suite_names())}, or a .toml file")
    return _read(Path(name))


def _read(path: Path) -> Suite:
    tables = tables_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
    sets = tables.get("set")
    for each in (tables.get("defaults"), *(sets if isinstance(sets, list) else ())):
        if isinstance(each, dict) and isinstance(each.get("layout"), str):
            layout = Layout.load(inside(path.parent, each["layout"]))
            each["layout"] = json.loads(layout.model_dump_json(by_alias=True))
    return model_from(Suite, path, tables)
