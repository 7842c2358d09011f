"""Simulated E36312A: an E3631A's outputs, each with its own switch and protection, behind channel lists.

Source: the list of contents of the E36300 Series Programming Guide (E36311-90008), users' drivers of the model, and
for times those of its sibling EDU36311A as a user's driver quotes its data sheet. What none of them has is the
E3631A's and unverified: the shape of replies, ``*RST`` levels, errors for a channel that is not there.

Output 3, which the E3631A's words call N25V, is positive at its terminals. On the bench its plus terminal is ground,
so that it gives the negative rail: what is kept here for N25V has the sign of the rail, what is said and asked not.

Not simulated: pairs in series and parallel, delays, lists, data log, remote sense, triggered levels.
"""

from __future__ import annotations

from collections.abc import Mapping  # msgspec reads the annotation of the errors
from types import MappingProxyType
from typing import Any, ClassVar

from msgspec.structs import replace

from simrack.instruments.e3631a.imperfections import OutputAccuracy
from simrack.instruments.e3631a.instrument import Settings, SimulatedE3631A, SupplyErrors
from simrack.instruments.e3631a.kinds import KINDS, OutputKind
from simrack.scpi import GPIB, LAN, USB, CommandTable, Dialect, Interface, Register

_OVER = 1.1
"""Over-voltage protection after ``*RST``, of the rated voltage (general knowledge, unverified)."""
_RATED_V = {"P6V": 6.0, "P25V": 25.0, "N25V": 25.0}
_RISE_S, _FALL_S = (0.08, 0.08), (0.5, 0.08)
"""Settling to 1 % at no load and at full load: EDU36311A data sheet (80 ms, down without load 500 ms); of the fall at
full load nothing is known."""


class Errors36312A(SupplyErrors, frozen=True):
    """Imperfections of an E36312A, of an E3631A's kinds; the accuracy is from memory and unverified."""

    accuracy: ClassVar[Mapping[str, OutputAccuracy]] = MappingProxyType(
        {
            "P6V": OutputAccuracy((3e-4, 3e-3), (1e-3, 5e-3), (3e-4, 3e-3)),
            "P25V": OutputAccuracy((3e-4, 5e-3), (1e-3, 2e-3), (3e-4, 5e-3)),
            "N25V": OutputAccuracy((3e-4, 5e-3), (1e-3, 2e-3), (3e-4, 5e-3)),
        }
    )


class SimulatedE36312A(SimulatedE3631A):
    """The supply; arguments as of the E3631A."""

    errors_class: ClassVar = Errors36312A
    table: ClassVar[CommandTable]
    dialect: ClassVar[Dialect] = Dialect(queue_depth=20, takes_blocks=False)
    interfaces: ClassVar[Mapping[str, Interface]] = MappingProxyType({"gpib": GPIB, "usb": USB, "lan": LAN})
    kinds: ClassVar[tuple[OutputKind, ...]] = tuple(replace(each, rise_s=_RISE_S, fall_s=_FALL_S) for each in KINDS)

    def __init__(
        self, world: Any, *, rails: Any = None, errors: Any, interface: str = "usb", model: str = "E36312A"
    ) -> None:
        self._forget()
        self.operation = Register()
        wired = {"P25V": "positive", "N25V": "negative"} if rails is None else rails
        super().__init__(world, rails=wired, errors=errors, interface=interface, model=model)

    def _forget(self) -> None:
        self.switched = dict.fromkeys(_RATED_V, False)
        self.over_v = {name: _OVER * rated for name, rated in _RATED_V.items()}
        self.over_v_on = dict.fromkeys(_RATED_V, False)
        self.over_a_on = dict.fromkeys(_RATED_V, False)
        self.tripped: dict[str, str] = dict.fromkeys(_RATED_V, "")
        self.trigger_sources = dict.fromkeys(_RATED_V, "BUS")
        self.awaiting: set[str] = set()
        """Outputs that INITiate has told to wait for a trigger."""
        self.sense = dict.fromkeys(_RATED_V, "INT")
        """Where outputs are sensed; with nothing at the sense terminals they sense inside (unverified)."""
        self.rise_delay_s, self.fall_delay_s = dict.fromkeys(_RATED_V, 0.0), dict.fromkeys(_RATED_V, 0.0)
        """Delays of OUTPut ON and OFF; kept, not kept to."""

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"Keysight Technologies,{self._model},MY59002391,2.1.0-1.0.4-1.12"

    def reset(self) -> None:
        """*RST."""
        self._forget()
        super().reset()

    def is_on(self, name: str) -> bool:
        """Tell whether output `name` is on: each has a switch of its own."""
        return self.switched[name]

    def restore(self, settings: Settings) -> None:
        """Take settings that *RCL recalls; which outputs it switches on is unverified, here none."""
        self.switched = dict.fromkeys(self.switched, False)
        super().restore(settings)

    def transfer_of(self, name: str) -> None:
        """Have the triggered levels of an output become its own."""
        self.awaiting.discard(name)
        output = self.outputs[name]
        self.program(name, volts=output.triggered_volts, amps=output.triggered_amps)
        output.triggered_volts = output.triggered_amps = None

    def switch(self, names: tuple[str, ...], *, on: bool) -> None:
        """Switch outputs; one that has tripped stays off until its protection is cleared."""
        for name in names:
            self.switched[name] = on and not self.tripped[name]
        self.drive()

    def regulate(self) -> None:
        """Find the working points, then trip outputs whose protection does not allow theirs."""
        super().regulate()
        for name, output in self.outputs.items():
            cause = self._cause(name, limited=output.limited)
            if cause and self.switched[name]:
                self.tripped[name], self.switched[name] = cause, False
                self.drive()

    def _cause(self, name: str, *, limited: bool) -> str:
        if self.over_v_on[name] and abs(self.outputs[name].volts) > self.over_v[name]:
            return "OV"
        return "OC" if limited and self.over_a_on[name] else ""
