"""The simulated 34461A and 34465A as they are made: a meter of the series behind the command table of its model."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from simrack.instruments.truevolt.commands import table
from simrack.instruments.truevolt.instrument import Errors34461A, Errors34465A, SimulatedTruevolt
from simrack.instruments.truevolt.kinds import KIND_34461A, KIND_34465A

if TYPE_CHECKING:
    from collections.abc import Mapping

    from simrack.instruments.hp34401a.functions import Function
    from simrack.instruments.truevolt.kinds import MeterKind
    from simrack.scpi import CommandTable


class Keysight34461ATwin(SimulatedTruevolt):
    """The 34461A."""

    errors_class: ClassVar = Errors34461A
    kind: ClassVar[MeterKind] = KIND_34461A
    functions: ClassVar[Mapping[str, Function]] = KIND_34461A.functions()
    table: ClassVar[CommandTable] = table(KIND_34461A)
    fast_apertures_s: ClassVar[Mapping[float, float]] = KIND_34461A.fast_apertures_s


class Keysight34465ATwin(SimulatedTruevolt):
    """The 34465A without options."""

    errors_class: ClassVar = Errors34465A
    kind: ClassVar[MeterKind] = KIND_34465A
    functions: ClassVar[Mapping[str, Function]] = KIND_34465A.functions()
    table: ClassVar[CommandTable] = table(KIND_34465A)
    fast_apertures_s: ClassVar[Mapping[float, float]] = KIND_34465A.fast_apertures_s
