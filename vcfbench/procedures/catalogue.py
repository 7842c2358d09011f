"""The procedures that can be run by name: those that come along, and those that installed packages bring.

Another package brings its own as entry points::

    [project.entry-points."vcfbench.procedures"]
    hysteresis = "acme.hysteresis:HYSTERESIS"

Names are known without importing anything; a procedure is imported when it is asked for. One that cannot be loaded is
an error when it is asked for and keeps no other from being run. Those that come along keep their names: a package that
takes one of them is told in the list.
"""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING

from vcfbench.errors import ConfigError, PlanError
from vcfbench.instructions.titles import BUILT_IN

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.metadata import EntryPoint
    from pathlib import Path

    from vcfbench.instructions.procedure import AnyProcedure


class Catalogue(Mapping[str, "AnyProcedure"]):
    """Every known procedure by name; each is imported when it is looked up."""

    def __getitem__(self, name: str) -> AnyProcedure:
        """Return the procedure called `name`.

        KeyError: there is none. ConfigError: its package cannot be loaded, or two bring one of this name.
        """
        if name in BUILT_IN:  # packages are not even looked for: that takes as long as reading the command line
            own = name.replace("-", "_")
            module = import_module(f"vcfbench.procedures.{own}")
            if hasattr(module, "__path__"):
                module = import_module(f"{module.__name__}.plan")
            built_in: AnyProcedure = getattr(module, own.upper())
            return built_in
        entries = _installed().get(name, ())
        if not entries:
            raise KeyError(name)
        if len(entries) > 1:
            raise ConfigError(f"the name {name!r} is taken twice: {self.origin(name)}; one of them has to be renamed")
        from vcfbench.instructions.procedure import Procedure  # noqa: PLC0415
        from vcfbench.procedures.own_code import mistake_in  # noqa: PLC0415  # few have any

        said = f"the procedure {name!r} of {_origin(entries[0])}"
        try:
            loaded = entries[0].load()
        except (Exception, SystemExit) as error:  # another package is anyone's code
            raise ConfigError(f"{said} cannot be loaded: {mistake_in(error)}") from error
        if isinstance(loaded, Procedure) and loaded.name == name:
            return loaded
        raise ConfigError(f"{said}: expected a Procedure of that name, got {loaded!r}")

    def __repr__(self) -> str:
        return f"<procedures {', '.join(self)}>"

    def __iter__(self) -> Iterator[str]:
        """Yield the names: those that come along first."""
        yield from BUILT_IN
        yield from sorted(set(_installed()) - set(BUILT_IN))

    def __len__(self) -> int:
        """Return the number of them."""
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        """Return True if there is a procedure called `name`."""
        return name in BUILT_IN or name in _installed()

    def title(self, name: str) -> str:
        """Return the title of the procedure called `name` if it is known without importing it."""
        if name not in BUILT_IN:
            return f"Of {self.origin(name)}."
        hidden = " and ".join(map(_origin, _installed().get(name, ())))
        title = BUILT_IN[name]
        return f"{title} That of {hidden} has to be renamed before it can be run." if hidden else title

    def origin(self, name: str) -> str:
        """Return the origin of the procedure called `name`, or ""."""
        own = ["vcfbench itself"] if name in BUILT_IN else []
        return " and ".join([*own, *map(_origin, _installed().get(name, ()))])

    def loaded(self) -> list[AnyProcedure]:
        """Return every procedure that can be loaded."""
        found = []
        for name in self:
            try:
                found.append(self[name])
            except ConfigError:  # it is told when it is asked for
                continue
        return found


PROCEDURES = Catalogue()
"""Every known procedure by name.

>>> len(vcfbench.PROCEDURES), vcfbench.PROCEDURES["zero"].title
(21, 'Record the output at rest: Allan deviation, noise coefficients, bias stability.')
"""


def is_file(name: str) -> bool:
    """Return True if `name`, of a procedure that is to be run, is that of a file."""
    return name.endswith(".py") or "/" in name or "\\" in name


def procedure(name: str | Path | AnyProcedure) -> AnyProcedure:
    """Return the procedure called `name`, the one that the file `name` defines, or `name` if it is one.

    PlanError: there is none; the words list those that there are. ConfigError: its file or its package cannot be used,
    or its name is taken twice.
    """
    if not isinstance(name, str | PathLike):
        from vcfbench.instructions.procedure import Procedure  # noqa: PLC0415  # with the first procedure

        if not isinstance(name, Procedure):
            raise PlanError(f"expected a procedure's name, its file or a Procedure, got {name!r}")
        if name.name in PROCEDURES and PROCEDURES[name.name] != name:  # its records would be read as that one's
            raise ConfigError(
                f"a Procedure is called {name.name!r}, a name taken by {PROCEDURES.origin(name.name)}", hint="rename it"
            )
        return name
    if not isinstance(name, str) or is_file(name):
        from vcfbench.procedures.own_code import procedure_in  # noqa: PLC0415

        return procedure_in(name, PROCEDURES.origin)
    try:
        return PROCEDURES[name]
    except KeyError:
        raise no_procedure(name) from None


def no_procedure(name: str) -> PlanError:
    """Return the error for an unknown name of a procedure, with the nearest name."""
    close = "".join(f" ({each!r}?)" for each in get_close_matches(name, PROCEDURES, n=1))
    return PlanError(f"there is no procedure {name!r}{close}", hint=f"known are {', '.join(PROCEDURES)}")


@cache  # looking through the installed packages takes milliseconds
def _installed() -> dict[str, tuple[EntryPoint, ...]]:
    from importlib.metadata import entry_points  # noqa: PLC0415

    found: dict[str, tuple[EntryPoint, ...]] = {}
    for entry in entry_points(group="vcfbench.procedures"):
        found[entry.name] = (*found.get(entry.name, ()), entry)
    return found


def _origin(entry: EntryPoint) -> str:
    package = "a package" if entry.dist is None else f"the package {entry.dist.name}"
    return f"{package} ({entry.value})"
