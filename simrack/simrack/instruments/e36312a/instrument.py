"""Simulated E36312A: an E3631A's outputs, each with its own switch and protection, behind channel lists.

Source: the list of contents of the E36300 Series Programming Guide (E36311-90008), users' drivers of the model, and
for times those of its sibling EDU36311A as a user's driver quotes its data sheet. What none of them has is the
E3631A's and unverified: the shape of replies, ``*RST`` levels, errors for a channel that is not there.

Output 3, which the E3631A's words call N25V, is positive at its terminals. On the bench its plus terminal is ground,
so that it gives the negative rail: what is kept here for N25V has the sign of the rail, what is said and asked not.

The guide has no switch of the over-voltage protection: it is on, and VOLTage:PROTection:STATe is what drivers send.
Paired outputs are only no longer set one by one; remote sense, with nothing at its terminals, reads 0 V (unverified).
Not simulated: delays of switching off, lists, data log, triggered levels.
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
        self.over_v_on = dict.fromkeys(_RATED_V, True)
        self.over_a_on = dict.fromkeys(_RATED_V, False)
        self.tripped: dict[str, str] = dict.fromkeys(_RATED_V, "")
        self.trigger_sources = dict.fromkeys(_RATED_V, "BUS")
        self.awaiting: set[str] = set()
        """Outputs that INITiate has told to wait for a trigger."""
        self.sense = dict.fromkeys(_RATED_V, "INT")
        self.rise_delay_s, self.fall_delay_s = dict.fromkeys(_RATED_V, 0.0), dict.fromkeys(_RATED_V, 0.0)
        self.switched_s = dict.fromkeys(_RATED_V, 0.0)
        """When outputs were switched on; each gives its level after its delay."""
        self.pair = "OFF"
        self.together: tuple[str, ...] = ()
        """Outputs that OUTPut:COUPle switches together."""

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"Keysight Technologies,{self._model},MY59002391,2.1.0-1.0.4-1.12"

    def reset(self) -> None:
        """*RST."""
        self._forget()
        super().reset()

    def is_on(self, name: str) -> bool:
        """Return True if output `name` gives its level: each has a switch of its own, and a delay."""
        return self.switched[name] and self.world.clock.now() >= self.switched_s[name] + self.rise_delay_s[name]

    def plan(self) -> None:
        """Work out when something next happens by itself: outputs come on after their delays, too."""
        super().plan()
        now = self.world.clock.now()
        due = [self.switched_s[name] + self.rise_delay_s[name] for name, on in self.switched.items() if on]
        self._next_s = min((each for each in (self._next_s, *due) if each is not None and each > now), default=None)

    def service(self) -> None:
        """Advance ramps, and drive outputs whose delay is over."""
        due = self._next_s is not None and self._next_s <= self.world.clock.now()
        super().service()
        if due:
            self.drive()

    def restore(self, settings: Settings) -> None:
        """Take settings that *RCL recalls; which outputs it switches on is unverified, here none."""
        self.switched = dict.fromkeys(self.switched, False)
        super().restore(settings)

    def transfer_of(self, name: str) -> None:
        """Make the triggered levels of an output its present ones."""
        self.awaiting.discard(name)
        output = self.outputs[name]
        self.program(name, volts=output.triggered_volts, amps=output.triggered_amps)
        output.triggered_volts = output.triggered_amps = None

    def switch(self, names: tuple[str, ...], *, on: bool) -> None:
        """Switch outputs; one that has tripped stays off until its protection is cleared."""
        if set(names) & set(self.together):
            names = (*names, *self.together)
        for name in names:
            if on and not self.switched[name]:
                self.switched_s[name] = self.world.clock.now()
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
