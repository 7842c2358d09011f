"""Settings of an instrument: typed values, the command of one of them, and rows that decorate their handlers."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from operator import attrgetter
from typing import Any, Self, TypeVar

from msgspec import Struct

from simrack.scpi.parameters import Parameter
from simrack.scpi.table import Command

_Handler = TypeVar("_Handler", bound="Callable[..., Any]")


class Settings(Struct):
    """Base of an instrument's settings: the defaults are those of ``*RST``, and a field may hold further ones."""

    def take(self, other: Self) -> None:
        """Become equal to `other`, sharing nothing with it."""
        for name in self.__struct_fields__:
            setattr(self, name, deepcopy(getattr(other, name)))


def attribute(
    pattern: str,
    parameter: Parameter,
    path: str,
    reply: Callable[[Any], str] | str = str,
    *,
    do: Callable[..., Any] | None = None,
    convert: Callable[[Any], Any] | None = None,
    then: Callable[[Any], Any] | None = None,
    takes_s: float = 0.0,
    query_parameters: tuple[Parameter, ...] | None = None,
) -> Command:
    """Declare a setting that is one attribute of the model.

    `attribute("TRIGger:SOURce", Choice(("IMMediate", "BUS")), "triggering.source")` sets and asks for
    `model.triggering.source`.

    Args:
        pattern: header as printed.
        parameter: what follows the header.
        path: attributes from the model on; `channel[].label` takes the item of the header's suffix, `setups[RES].nplc`
            that of a name.
        reply: format of the reply, or the path of the model's method that makes it.
        do: sets it instead, where that takes more than an assignment.
        convert: what is kept of an argument.
        then: what the model does when it has been set.
        takes_s: simulated time before it is set, s.
        query_parameters: as of :class:`Command`.
    """
    owners, _, name = path.rpartition(".")
    steps = [step.removesuffix("]").partition("[") for step in owners.split(".") if step]

    def owner(model: Any, suffixes: tuple[Any, ...]) -> Any:
        remaining = iter(suffixes)
        for step, indexed, item in steps:
            model = getattr(model, step)
            model = model[item or next(remaining)] if indexed else model
        return model

    def write(model: Any, *arguments: Any) -> None:
        value = arguments[-1] if convert is None else convert(arguments[-1])
        setattr(owner(model, arguments[:-1]), name, value)
        if then is not None:
            then(model)

    def read(model: Any, *suffixes: Any) -> Any:
        value = getattr(owner(model, suffixes), name)
        return attrgetter(reply)(model)(value) if isinstance(reply, str) else value

    return Command(
        pattern,
        (parameter,),
        do=do or write,
        query=read if isinstance(reply, str) or "[" in path or "<" in pattern else attrgetter(path),
        query_parameters=query_parameters,
        reply=str if isinstance(reply, str) else reply,
        takes_s=takes_s,
        reads=True,
    )


def remembered(
    pattern: str, parameter: Parameter, default: Any, reply: Callable[[Any], str] = str, **row: Any
) -> Command:
    """Declare a setting without effect on this bench: it is kept and reported, and ``*RST`` sets `default`."""

    def write(model: Any, *arguments: Any) -> None:
        *suffixes, value = arguments
        model.engine.remembered[pattern, *suffixes] = value

    def read(model: Any, *suffixes: Any) -> Any:
        return model.engine.remembered.get((pattern, *suffixes), default)

    return Command(pattern, (parameter,), do=write, query=read, reply=reply, reads=True, **row)


class Rows(list[Command]):
    """Rows of a command table that decorate their handlers.

    `@ROWS.do("*TRG", urgent=True)` above a function declares `Command("*TRG", do=function, urgent=True)`.
    """

    def do(self, pattern: str, parameters: tuple[Parameter, ...] = (), **more: Any) -> Callable[[_Handler], _Handler]:
        """Declare a :class:`Command` whose command form is the function below."""
        return self._keep(lambda handler: Command(pattern, parameters, do=handler, **more))

    def query(
        self, pattern: str, parameters: tuple[Parameter, ...] = (), **more: Any
    ) -> Callable[[_Handler], _Handler]:
        """Declare a :class:`Command` whose query is the function below."""
        return self._keep(lambda handler: Command(pattern, parameters, query=handler, **more))

    def attribute(self, *row: Any, **more: Any) -> Callable[[_Handler], _Handler]:
        """Declare an :func:`attribute` that the function below sets."""
        return self._keep(lambda handler: attribute(*row, do=handler, **more))

    def _keep(self, row_of: Callable[[_Handler], Command]) -> Callable[[_Handler], _Handler]:
        def keep(handler: _Handler) -> _Handler:
            self.append(row_of(handler))
            return handler

        return keep
