"""A simulated Agilent 33220A, 20 MHz function generator.

The manual itself was not at hand: ranges, coupling rules and most wordings come from its quotations in public
drivers and from the guides of its siblings (33210A, 33250A, 33500 series), and the power-on replies from the record
of a real 33250A. What only general knowledge supports (the words of -221 and -222, errors 781...788, times, which
parameter wins a conflict) is unverified.

The parts: `commands` is the command table, made of the `..._commands` of each subsystem,
`settings` what can be set, `levels` the amplitude and offset, `rules` what goes
together, `arbitrary` the waveform memory. `modulation` makes of the settings what comes
out: `waveforms` by `phases`, played by `playing`, or `noise`.
"""

from __future__ import annotations

import math
from copy import deepcopy
from typing import ClassVar, Protocol

from simrack import scpi
from simrack.clock import Clock
from simrack.instruments.agilent33220a import settings
from simrack.instruments.agilent33220a.arbitrary import MOST_POINTS, ArbitraryMemory
from simrack.instruments.agilent33220a.levels import Levels
from simrack.instruments.agilent33220a.modulation import Player
from simrack.instruments.agilent33220a.rules import SettingRules
from simrack.scpi import CommandTable
from simrack.sources import Drive, Played

_LONGEST_LINE = 15 * MOST_POINTS + 1024
"""Every point of the longest waveform as -1.2345678E-01 and a comma; what a real one takes is unverified."""


class GeneratorWorld(Protocol):
    """The part of the World that the generator needs."""

    @property
    def clock(self) -> Clock:
        """Bench time."""

    def drive(self, node: str, source: Drive | Played | None) -> None:
        """Connect the source to an input, or None."""


class SimulatedAgilent33220A(scpi.ScpiTwin):
    """The generator. `interface` is usb, gpib or lan; it has no RS-232. `noise_seed` is the seed of its noise.

    `model` is what it calls itself, where it stands for a generator that speaks the same words; `node` is what its
    output is wired to.
    """

    errors_class: ClassVar = settings.GeneratorErrors
    own_name: ClassVar[str] = "33220A"
    kind: ClassVar[settings.GeneratorKind] = settings.KIND_33220A
    table: ClassVar[CommandTable]
    longest_line: ClassVar[int] = _LONGEST_LINE

    def __init__(
        self,
        world: GeneratorWorld,
        errors: settings.GeneratorErrors,
        interface: str = "usb",
        noise_seed: int = 0,
        model: str | None = None,
        *,
        node: str = "input",
    ) -> None:
        self._node = node
        self._model = model or self.own_name
        self._world = world
        self.state = self.reset_state()
        self._stored = {0: self.reset_state()}  # at power-down; it was off for long
        self.state_names = {0: "AUTO_RECALL", 1: "STATE_1", 2: "STATE_2", 3: "STATE_3", 4: "STATE_4"}
        self.panel = settings.Panel()
        self._started_s: float | None = None
        self._driven: Drive | Played | None = None
        self._questionable = scpi.Register()
        self.operation = scpi.Register()
        self.engine = self.made_engine(interface)
        self.memory = self.made_memory((1 << errors.dac_bits) // 2 - 1 if errors.dac_bits else 0)
        self.levels = self.made_levels(errors)
        self.rules = SettingRules(self.kind, self.state, self.levels, self.engine.report)
        clock_hz = self.kind.arbitrary_clock_hz
        self._player = Player(self.state, errors, self.levels, self.memory, noise_seed, clock_hz=clock_hz)
        world.drive(node, None)

    def made_engine(self, interface: str) -> scpi.ScpiEngine:
        """Return the message exchange at an interface."""
        return scpi.ScpiEngine(
            self,
            self.table,
            self._world.clock,
            dialect=scpi.Dialect(out_of_range=scpi.clip, input_limit=self.longest_line),
            interface={"usb": scpi.USB, "gpib": scpi.GPIB, "lan": scpi.LAN}[interface],
            status=scpi.Status({3: self._questionable}),
        )

    def made_memory(self, full_scale: int) -> ArbitraryMemory:
        """Return the waveform memory of the model."""
        return ArbitraryMemory(full_scale)

    def made_levels(self, errors: settings.GeneratorErrors) -> Levels:
        """Return the rules between amplitude and offset of the model."""
        return Levels(self.state, errors, self.memory, self.engine.report)

    def reset_state(self) -> settings.GeneratorSettings:
        """Return the settings of ``*RST``."""
        return settings.GeneratorSettings()

    @property
    def questionable(self) -> scpi.Register:
        """The QUEStionable register; this model never sets its bits: nothing here overloads or loses lock."""
        return self._questionable

    def identity(self) -> str:
        """Return the reply of a real unit, but for the model that it stands for."""
        return f"Agilent Technologies,{self._model},MY44021876,2.02-2.02-22-2"

    def reset(self) -> None:
        """Take the *RST state: output off; stored waveforms and states stay."""
        self.state.take(self.reset_state())
        self.restart()

    def abort(self) -> None:
        """Device clear ends a running burst or sweep."""
        if self.operations_end_s() > self.engine.clock.now():
            self.restart()

    def operations_end_s(self) -> float:
        """*OPC, *OPC? and *WAI wait for a triggered burst or sweep."""
        if self._started_s is None or not self._triggered():
            return -math.inf
        state = self.state
        return self._started_s + float(state.sweep_s if state.mode == "SWE" else state.cycles / state.frequency_hz)

    # --- states -----------------------------------------------------------------------------------------------------

    def save(self, place: int) -> None:
        """*SAV."""
        self._stored[place] = deepcopy(self.state)

    def recall(self, place: int) -> None:
        """*RCL; an empty place is error 810 (unverified)."""
        if place not in self._stored:
            raise scpi.ScpiError(810, "State has not been stored")
        self.state.take(self._stored[place])
        self.restart()

    def forget(self, place: int) -> None:
        """MEMory:STATe:DELete."""
        self._stored.pop(place, None)

    def has_stored(self, place: int) -> bool:
        """MEMory:STATe:VALid?."""
        return place in self._stored

    # --- settings that others depend on -----------------------------------------------------------------------------

    def settle(self) -> None:
        """Make the settings fit each other, then update the output."""
        self.rules.fit()
        self.update()

    def set_frequency(self, frequency_hz: float) -> None:
        """Set the frequency; HOLD selects whether a pulse keeps its width or its duty cycle."""
        old = self.state.frequency_hz
        self.state.frequency_hz = frequency_hz
        if self.state.hold == "DCYC":
            self.state.width_s *= old / frequency_hz
        self.settle()

    def switch_mode(self, mode: str, *, on: bool) -> None:
        """Switch modulation, sweep or burst; a sweep or burst of the internal timer begins now."""
        self.rules.switch_mode(mode, on=on)
        self.restart()

    def load(self, points: list[float]) -> None:
        """Take the volatile waveform."""
        self.memory.load(points)
        self.update()

    def delete(self, name: str) -> None:
        """Forget a waveform."""
        self.memory.delete(name, self.state.user if self.state.function == "USER" else "")

    # --- triggers -----------------------------------------------------------------------------------------------------

    def fire(self) -> None:
        """Take a trigger; -211 when neither burst nor sweep waits for one. One under way goes on (unverified)."""
        if not self._triggered():
            raise scpi.ScpiError(-211)
        now = self.engine.clock.now()
        if self.operations_end_s() <= now:
            self._started_s = now + self._delay_s()
            self.update()

    def _triggered(self) -> bool:
        """Return True if bursts or sweeps begin with a trigger from outside."""
        state = self.state
        gated = state.mode == "BURS" and state.burst_mode == "GAT"
        return state.mode in {"BURS", "SWE"} and state.trigger != "IMM" and not gated

    def restart(self) -> None:
        """Restart bursts or sweeps: those of the internal timer now, others with the next trigger."""
        self._started_s = None if self._triggered() else self.engine.clock.now() + self._delay_s()
        self.update()

    def _delay_s(self) -> float:
        """Return the trigger delay, which only bursts have."""
        return float(self.state.delay_s) if self.state.mode == "BURS" else 0.0

    # --- the output ---------------------------------------------------------------------------------------------------

    def take_phase_as_reference(self) -> None:
        """PHASe:REFerence: set the present phase to 0; the output does not change."""
        self._player.absorb_phase()
        self.update()

    def put_out(self, source: Drive | Played) -> Drive | Played | None:
        """Return the output of the function `source`."""
        return source

    def update(self) -> None:
        """Put the present output on the World, if it has changed."""
        now = self.engine.clock.now()
        source = self.put_out(self._player.source(self._started_s, now)) if self.state.output else None
        if source != self._driven:
            self._driven = source
            self._world.drive(self._node, source)
