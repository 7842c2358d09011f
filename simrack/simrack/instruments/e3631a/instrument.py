"""Simulated E3631A triple supply: three outputs on the rails of the World, behind the commands of the guide.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 84-108 commands, 113-122 status, 139-146 errors,
186-188 specifications). What the guide leaves open is marked *unverified*. Its parts: :mod:`.kinds`,
:mod:`.errors`, :mod:`.output`, :mod:`.calibration`, and the commands in :mod:`.commands`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from types import MappingProxyType
from typing import ClassVar

from msgspec import Struct

from simrack.adjustment import Adjustment
from simrack.instruments.e3631a.calibration import SupplyCalibration
from simrack.instruments.e3631a.imperfections import OutputErrors, SupplyErrors
from simrack.instruments.e3631a.kinds import KINDS, OutputKind
from simrack.instruments.e3631a.output import SupplyOutput, stepped
from simrack.scpi import (
    GPIB,
    RS232,
    CommandTable,
    Dialect,
    Interface,
    Register,
    ScpiEngine,
    ScpiTwin,
    Status,
    bare_integer,
)
from simrack.world import World

__all__ = ["OutputErrors", "SimulatedE3631A", "SupplyErrors"]

_INTERFACES = {"gpib": GPIB, "rs232": RS232}
_DIALECT = Dialect(
    queue_depth=20,
    words={708: "Cal output disabled", 712: "Bad DAC cal data", 713: "Bad readback cal data"},
    number_not_allowed=-128,
    integer=bare_integer,
    input_buffer=100,
    output_queue=1024,
    takes_blocks=False,
)
"""The guide prints every integer of a reply bare; that the wire has no sign either is unverified.

The input buffer of about 100 characters is that of RS-232 (p. 80); that it is the same on GPIB is unverified.
"""
_LIMITED_LOOK_S = 0.01
"""How often an output in constant current looks at its load, which may let go by itself: a PCB that has started."""
_LIMITED_PATIENCE_S = 2.0
"""For how long it does so after its voltage last moved."""
_FAN = 16
"""Bit of the questionable status (p. 113)."""


class Settings(Struct, frozen=True):
    """Settings that *SAV stores (p. 96)."""

    selected: str
    levels: tuple[tuple[float, float], ...]
    output_on: bool
    tracking: bool
    source: str
    delay_s: float


DEFAULT_SETTINGS = Settings(
    selected="P6V",
    levels=tuple((kind.volts[2] or 0.0, kind.amps[2] or 0.0) for kind in KINDS),
    output_on=False,
    tracking=False,
    source="BUS",
    delay_s=0.0,
)
_RAILS: Mapping[str, str] = MappingProxyType({"P25V": "positive", "N25V": "negative"})


class SimulatedE3631A(ScpiTwin):
    """The supply.

    Args:
        world: where its outputs lead.
        rails: output to power pin of the PCB; outputs that are not in it have no load.
        errors: imperfections of this specimen.
        interface: "gpib" or "rs232", one of which is selected on the front panel.
        model: what it calls itself, where it stands for a supply that speaks the same words.
    """

    errors_class: ClassVar = SupplyErrors
    table: ClassVar[CommandTable]
    dialect: ClassVar[Dialect] = _DIALECT
    interfaces: ClassVar[Mapping[str, Interface]] = MappingProxyType(_INTERFACES)
    kinds: ClassVar[tuple[OutputKind, ...]] = KINDS

    def __init__(
        self,
        world: World,
        *,
        rails: Mapping[str, str] = _RAILS,
        errors: SupplyErrors,
        interface: str = "gpib",
        model: str = "E3631A",
    ) -> None:
        self._model = model
        self.world = world
        self.errors = errors
        self.questionable = Register()
        self.instrument_summary = Register(self.questionable, 13)
        registers = [Register(self.instrument_summary, kind.number) for kind in self.kinds]
        self.outputs = {
            kind.name: SupplyOutput(kind, world, rails.get(kind.name), register, errors)
            for kind, register in zip(self.kinds, registers, strict=True)
        }
        status = Status({3: self.questionable}, (*registers, self.instrument_summary))
        self.engine = ScpiEngine(
            self, self.table, world.clock, dialect=self.dialect, interface=self.interfaces[interface], status=status
        )
        self.stored: dict[int, Settings] = {}
        self.local = True
        self.initiated = False
        self.transfer_at_s: float | None = None
        self._next_s: float | None = None
        self._looks_until_s = -math.inf
        self._seen: Hashable = None
        self.calibration = SupplyCalibration()
        self.display_on = True
        self.display_text = ""
        self.coupled: tuple[str, ...] = ()
        self.restore(DEFAULT_SETTINGS)
        world.on_load(self.regulate)

    # --- what the engine asks -----------------------------------------------------------------------------

    def identity(self) -> str:
        """Return the identity; the firmware numbers are typical, unverified."""
        return f"HEWLETT-PACKARD,{self._model},0,2.1-5.0-1.0"

    def reset(self) -> None:
        """*RST (p. 97)."""
        self.coupled = ()
        self.display_on = True
        self.display_text = ""
        for output in self.outputs.values():
            output.forget_triggered()
        self.restore(DEFAULT_SETTINGS)

    def service(self) -> None:
        """Advance ramps and the trigger delay."""
        if self._next_s is not None and self._next_s <= self.world.clock.now():
            self._advance()
        if self.instrument_summary.enable:
            self.observe()

    def next_event_s(self) -> float | None:
        """Return the next look at an output that moves, or the end of the trigger delay."""
        return self._next_s

    def _advance(self) -> None:
        now = self.world.clock.now()
        if self.transfer_at_s is not None and self.transfer_at_s <= now:
            self.transfer_at_s = None
            self.transfer()
        for output in self.outputs.values():
            output.advance(now)
        self.regulate()

    def plan(self) -> None:
        """Work out when something next happens by itself."""
        instants = [instant for output in self.outputs.values() if (instant := output.next_s()) < math.inf]
        if any(output.limited for output in self.outputs.values()) and self.world.clock.now() < self._looks_until_s:
            instants.append(self.world.clock.now() + _LIMITED_LOOK_S)
        if self.transfer_at_s is not None:
            instants.append(self.transfer_at_s)
        self._next_s = min(instants, default=None)

    def abort(self) -> None:
        """Device clear: the trigger system goes idle."""
        self.initiated = False
        self.transfer_at_s = None
        self.plan()

    def operations_end_s(self) -> float:
        """Return when the triggered change is through: an INITiate waits for its trigger."""
        if self.initiated:
            return math.inf
        return -math.inf if self.transfer_at_s is None else self.transfer_at_s

    def adjustments(self) -> list[Adjustment]:
        """Return the adjustments from outside the wire."""
        return [Adjustment("fan_failed", "", "whether its fan has stopped", self.fan_failed, self.fail_fan)]

    def fan_failed(self) -> bool:
        """True if the fan has stopped."""
        return bool(self.questionable.condition & _FAN)

    def fail_fan(self, failed: object) -> None:
        """Stop the fan, or let it run: bit 4 of the questionable status (p. 113). The outputs stay as they are."""
        self.questionable.set_bits(_FAN, _FAN if failed else 0)

    # --- outputs ------------------------------------------------------------------------------------------

    @property
    def output(self) -> SupplyOutput:
        """The selected output."""
        return self.outputs[self.selected]

    def is_on(self, name: str) -> bool:
        """Return True if output `name` is on: one switch has all three."""
        del name
        return self.output_on

    def observe(self) -> None:
        """Bring regulation and condition registers up to now; outputs at rest stay as they are while their loads do."""
        drawing = self.world.drawing()
        if drawing is not None and drawing == self._seen:
            return
        for output in self.outputs.values():
            output.show(on=self.is_on(output.kind.name))
        self._seen = drawing if all(output.at_rest for output in self.outputs.values()) else None

    def regulate(self) -> None:
        """Find the working point of every output: the load of one rail may depend on the other."""
        before, self._seen = self._working_points(), None
        self.observe()
        if self._working_points() != before:
            self._looks_until_s = self.world.clock.now() + _LIMITED_PATIENCE_S
        self.plan()

    def _working_points(self) -> list[float]:
        return [output.terminal.goal_v for output in self.outputs.values()]

    def drive(self) -> None:
        """Send every output towards its setting."""
        for name, output in self.outputs.items():
            on = self.is_on(name)
            output.head_for(self.open_circuit_v(name) if on else 0.0)
            output.reverse_v = 0.0 if on else output.errors.reverse_v
        self.regulate()

    def open_circuit_v(self, name: str) -> float:
        """Return the voltage of output `name` without load when it is on."""
        output = self.outputs[name]
        volts = stepped(output.volts, output.kind.volt_step) if self.errors.quantised else output.volts
        gain, offset = output.errors.programming_gain, output.errors.programming_offset_v
        if name == "N25V" and self.tracking:
            gain, offset = gain + self.errors.tracking_gain, offset + self.errors.tracking_offset_v
        gain += output.errors.line_gain
        return volts * (1.0 + gain) + output.kind.sign * offset

    def program(self, name: str, *, volts: float | None = None, amps: float | None = None) -> None:
        """Take levels for output `name`; while tracking a voltage goes to its twin too."""
        output = self.outputs[name]
        if amps is not None:
            output.amps = amps
        if volts is not None:
            output.volts = volts
            if self.tracking and name != "P6V":
                self.outputs["N25V" if name == "P25V" else "P25V"].volts = -volts
        self.drive()

    def transfer(self) -> None:
        """The trigger: pending levels of the coupled outputs (of the selected one if none is) become immediate."""
        for name in self.coupled or (self.selected,):
            output = self.outputs[name]
            self.program(name, volts=output.triggered_volts, amps=output.triggered_amps)
            output.forget_triggered()

    # --- stored states ------------------------------------------------------------------------------------

    def save(self, slot: int) -> None:
        """*SAV."""
        self.stored[slot] = self.settings()

    def recall(self, slot: int) -> None:
        """*RCL: a slot that is empty gives the *RST state (p. 96)."""
        self.restore(self.stored.get(slot, DEFAULT_SETTINGS))

    def settings(self) -> Settings:
        """Return the settings that *SAV stores."""
        levels = tuple((output.volts, output.amps) for output in self.outputs.values())
        return Settings(self.selected, levels, self.output_on, self.tracking, self.trigger_source, self.trigger_delay_s)

    def restore(self, settings: Settings) -> None:
        """Take settings that *RCL recalls."""
        self.selected = settings.selected
        self.output_on = settings.output_on
        self.tracking = settings.tracking
        self.trigger_source = settings.source
        self.trigger_delay_s = settings.delay_s
        self.initiated = False
        self.transfer_at_s = None
        for output, (volts, amps) in zip(self.outputs.values(), settings.levels, strict=True):
            output.volts, output.amps = volts, amps
        self.drive()
