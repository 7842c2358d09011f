"""Settings of an instrument: typed values, and the command that sets and asks for one of them."""

from __future__ import annotations

from copy import deepcopy
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Self

from msgspec import Struct

from simrack.scpi.table import Command

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.scpi.parameters import Parameter


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
        query=read,
        query_parameters=query_parameters,
        reply=str if isinstance(reply, str) else reply,
        takes_s=takes_s,
    )
