"""The simulated 34461A and 34465A multimeters (Truevolt series)."""

from collections.abc import Mapping
from typing import Self

from msgspec.structs import replace

from simrack.instruments.truevolt import calculation_commands, measuring_commands, range_commands, system_commands
from simrack.instruments.truevolt.instrument import SimulatedTruevolt, errors_of
from simrack.instruments.truevolt.kinds import KINDS
from simrack.scpi import COMMON_COMMANDS, CommandTable

__all__ = ["Keysight34461ATwin", "Keysight34465ATwin", "SimulatedTruevolt", "TruevoltTwin"]


class TruevoltTwin(SimulatedTruevolt):
    """A meter of the series with its commands, made by :meth:`of_model`."""

    @classmethod
    def of_model(
        cls,
        model: str,
        *,
        like: str | None = None,
        memory_readings: int | None = None,
        fast_apertures_s: Mapping[float, float] | None = None,
        **_of_its_driver: object,
    ) -> type[Self]:
        """Return the simulated model of the series.

        It is a row of :data:`.kinds.KINDS`, or one `like` such a row but for the numbers given.
        """
        known = KINDS[like or model]
        memory = known.memory if memory_readings is None else memory_readings
        fast = known.fast_apertures_s if fast_apertures_s is None else fast_apertures_s
        kind = replace(known, model=model, memory=memory, fast_apertures_s=fast)
        own = {
            "own_name": model,
            "errors_class": errors_of(kind),
            "kind": kind,
            "functions": kind.functions(),
            "fast_apertures_s": kind.fast_apertures_s,
            "table": CommandTable(
                *COMMON_COMMANDS,
                *measuring_commands.commands(kind),
                *range_commands.commands(kind),
                *calculation_commands.COMMANDS,
                *system_commands.commands(kind),
            ),
        }
        return type(cls.__name__, (cls,), {**own, "__doc__": cls.__doc__})


Keysight34461ATwin = TruevoltTwin.of_model("34461A")
Keysight34465ATwin = TruevoltTwin.of_model("34465A")
