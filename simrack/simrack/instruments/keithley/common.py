"""Common parts of the simulated 2000 and DMM6500: ranges, integration, relative values, specimens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simrack import scpi
from simrack.instruments.hp34401a.functions import BY_NAME, Function
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.hp34401a.range_commands import RANGED, bandwidth_command, gate_command, range_commands
from simrack.instruments.hp34401a.setup import Setup
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import NOTHING_THERE
from simrack.instruments.truevolt.mathematics import scaled
from simrack.instruments.truevolt.measuring_commands import once_idle
from simrack.instruments.truevolt.system_commands import preset_status
from simrack.specifications import VoltmeterSpecification

_NR3 = scpi.real(8)
_CALLED = (
    *(("VOLT", "VOLT:DC", "VDC"), ("VOLT:AC", "VOLT:AC", "VAC"), ("CURR", "CURR:DC", "ADC")),
    *(("CURR:AC", "CURR:AC", "AAC"), ("RES", "RES", "OHM"), ("FRES", "FRES", "OHM4W"), ("FREQ", "FREQ", "HZ")),
    *(("PER", "PER", "SEC"), ("CONT", "CONT", "OHM"), ("DIOD", "DIOD", "VDC"), ("TEMP", "TEMP", "C")),
)
NAMES = MappingProxyType({name: shown for name, shown, _ in _CALLED})
"""The functions that are simulated, and what the makers call them in replies; nothing is wired to the current input."""
UNITS = MappingProxyType({name: unit for name, _, unit in _CALLED})
"""Units as the 2000 writes them behind a reading (users' records of its readings; OHM4W and C unverified)."""
_SHORT = {
    word.upper(): "".join(filter(str.isupper, word))
    for word in (
        *("VOLTage", "CURRent", "RESistance", "FRESistance", "FREQuency", "PERiod", "CONTinuity", "DIODe"),
        *("TEMPerature", "CAPacitance", "RATio"),
    )
}
ERROR_WORDS = {-222: "Parameter data out of range", -230: "Data corrupt or stale"}
"""Words that differ from SCPI's (manuals of both, as users quote them)."""


def functions_of(sheet: VoltmeterSpecification, *more: str, **headers: str) -> Mapping[str, Function]:
    """Return the functions by name: a 34401A's with the resolutions of `sheet`, and `more`; some with other headers."""
    all_ = BY_NAME | NOTHING_THERE
    return MappingProxyType(
        {
            name: replace(
                all_[name],
                header=headers.get(name, all_[name].header),
                fractions=sheet.resolution if all_[name].integrating else all_[name].fractions,
            )
            for name in (*NAMES, *more, "VOLT:RAT")
        }
    )


def errors_of(sheet: VoltmeterSpecification) -> type[MeterErrors]:
    """Return the imperfections of a model: a 34401A's, in direct voltage drawn from its own data sheet.

    They are drawn uniformly within the 1-year accuracy of the 10 V range.
    """

    class KeithleyErrors(MeterErrors, frozen=True):
        """Imperfections of one specimen."""

        @classmethod
        def drawn(cls, rng: np.random.Generator) -> KeithleyErrors:
            """Return a specimen drawn from the data sheet."""
            like, limit = MeterErrors.drawn(rng), sheet.accuracy_of(10.0, 365)
            fields = {name: getattr(like, name) for name in MeterErrors.__struct_fields__}
            gain_error, offset_v = (float(rng.uniform(-each, each)) for each in (limit.reading, limit.range * 10.0))
            return cls(**{**fields, "gain_error": gain_error, "offset_v": offset_v})

    return KeithleyErrors


class Formula(Struct):
    """Arithmetic of a function, applied to each of its readings."""

    on: bool = False
    form: str = "PERC"
    factor: float = 1.0
    offset: float = 0.0
    percent: float = 1.0


def formula_commands(root: str, path: str, forms: tuple[str, ...], inner: str = "") -> tuple[scpi.Command, ...]:
    """Declare switch, form and factors below `root`; `inner` precedes the factors."""
    number = scpi.Number(limits=scpi.Limits(-1e12, 1e12))
    factors = (("MMFactor", "factor"), ("MBFactor", "offset"), ("PERCent", "percent"))
    return (
        scpi.attribute(f"{root}:STATe", scpi.Boolean(), f"{path}.on", scpi.boolean),
        scpi.attribute(f"{root}:FORMat", scpi.Choice(forms), f"{path}.form"),
        *(scpi.attribute(f"{root}{inner}:{word}", number, f"{path}.{name}", _NR3) for word, name in factors),
    )


class SimulatedKeithley(SimulatedTruevolt):
    """Common parts of both Keithley meters: filter and formula of each function, and a unit of voltages."""

    fast_apertures_s: ClassVar[Mapping[float, float]] = {}
    kept: dict[str, KeptOfFunction]
    formulas: dict[str, Formula]
    unit: str

    def forget(self) -> None:
        """A setting changes: the measurement ends."""
        self.triggering.abort()

    def averages_over(self) -> int:
        """Return the number of readings that the filter of the function moves over."""
        own = self.kept.get(self.function.name)
        return own.count if own is not None and own.average and own.averaging == "MOV" else 1

    def calculated(self, reading: float) -> float:
        """Return a reading by the formula of its function, then in its unit."""
        formula = self.formulas.get(self.function.name)
        if formula is not None and formula.on:
            reading = scaled(reading, formula.form, formula.factor, formula.offset, formula.percent)
        if self.function.name != "VOLT" or self.unit in {"V", "VOLT"}:
            return reading
        return scaled(reading, self.unit, 1.0, 0.0, 1.0)  # over 1 V, in 1 ohm (defaults unverified)


def ignored(meter: SimulatedTruevolt, *values: Any) -> None:
    """Take a command without any effect on this bench."""
    del meter, values


SHARED = (
    *scpi.COMMON_COMMANDS,
    scpi.remembered("FORMat:BORDer", scpi.Choice(("NORMal", "SWAPped")), "SWAP"),
    scpi.Command("SYSTem:LFRequency", query=lambda meter: str(meter.line_hz), reads=True),
    scpi.Command("SYSTem:BEEPer[:IMMediate]", (scpi.Number(), scpi.Number()), do=ignored),
    scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),
    scpi.Command("SYSTem:CLEar", do=lambda meter: meter.engine.errors.clear()),
    scpi.Command("*TST", query=lambda _: "0", query_takes_s=2.0),
    *scpi.status_commands("OPERation", "operation"),
    *scpi.status_commands("QUEStionable", "questionable"),
    scpi.Command("STATus:PRESet", do=preset_status),
)
"""Rows of both."""


def function_command(
    pattern: str, reply: Callable[[str], str] = scpi.quoted, names: Mapping[str, str] = NAMES
) -> scpi.Command:
    """Declare the choice of a function by name (VOLT:DC, VOLTage, RESistance); `names` are those of replies."""
    by_reply = {shown: name for name, shown in names.items()}

    def choose(meter: SimulatedTruevolt, text: str) -> None:
        typed = ":".join(_SHORT.get(word, word) for word in text.strip().upper().split(":"))
        if typed not in names and typed not in by_reply:
            raise scpi.ScpiError(-224)
        meter.choose(meter.functions[by_reply.get(typed, typed)])

    return scpi.Command(
        pattern, (scpi.Text(),), do=choose, query=lambda meter: names[meter.function.name], reply=reply, reads=True
    )


def digits_commands(
    functions: Mapping[str, Function], root: str, limits: scpi.Limits, names: Iterable[str] = NAMES
) -> tuple[scpi.Command, ...]:
    """Declare the digits of each function, which are only shown."""
    return tuple(
        scpi.attribute(
            f"{root}{functions[name].header}:DIGits",
            scpi.Integer(limits=limits),
            f"kept[{name}].digits",
            scpi.signed_integer,
        )
        for name in names
    )


def with_sense(commands: Iterable[scpi.Command]) -> tuple[scpi.Command, ...]:
    """Return commands whose ``[SENSe:]`` may be written with its 1, as ``:SENS1:``."""
    return tuple(replace(each, pattern=each.pattern.replace("[SENSe:]", "[SENSe<1-1>:]")) for each in commands)


class KeptOfFunction(Struct):
    """Settings of a function: of its filter the moving one changes readings, repeating takes no time here; digits."""

    average: bool
    digits: int
    averaging: str = "REP"
    count: int = 10
    line_sync: bool = False
    auto_delay: bool = True


FILTERS = MappingProxyType({3.0: 3.0, 30.0: 20.0, 300.0: 200.0})
"""Bandwidths of alternating functions, and the filters of a 34401A that stand for them (DMM6500 manual, p. 13-105)."""


class Words(Struct, frozen=True):
    """Words of one of the meters for the settings of its functions, and their ends.

    Args:
        relative: its word for what is taken off readings.
        integrating: functions whose integration time can be set. cycles: least of it in power line cycles, and most.
        gates: gate times of frequency and period. threshold: header of the range of their signal.
        more: functions beside those of both meters that average and take a value off.
        number: form of a reply.
    """

    relative: str
    integrating: tuple[str, ...]
    cycles: Callable[[SimulatedTruevolt], scpi.Limits]
    gates: scpi.Limits
    threshold: str
    more: tuple[str, ...] = ()
    number: Callable[[Any], str] = _NR3


def _setup(meter: SimulatedTruevolt, name: str) -> Setup:
    return meter.setups["VOLT" if name == "VOLT:RAT" else name]


def integration(name: str, header: str, parameter: scpi.Number, reply: Callable[[Any], str], unit: Any) -> scpi.Command:
    """Declare an integration time, of which a power line cycle has `unit(meter)`; the resolution goes with it."""

    def write(meter: SimulatedTruevolt, value: float) -> None:
        setup = _setup(meter, name)
        setup.nplc = value / unit(meter)
        setup.resolution = meter.functions[name].fraction_of(setup.nplc)

    return scpi.Command(
        f"[SENSe:]{header}",
        (parameter,),
        do=write,
        query=lambda meter: _setup(meter, name).nplc * unit(meter),
        reply=reply,
        reads=True,
    )


def _acquire(name: str) -> Callable[[SimulatedTruevolt], Any]:
    """Take a reading for what is taken off later ones."""

    def keep(meter: SimulatedTruevolt) -> None:
        null, last = meter.nulls[name], meter.ring.last
        null.value = (last or 0.0) + (null.value if null.on else 0.0)

    def acquire(meter: SimulatedTruevolt) -> Any:
        if meter.triggering.sequence is None:
            meter.triggering.start(stored=True)
        return once_idle(meter, lambda: keep(meter))

    return acquire


def settings_of_functions(functions: Mapping[str, Function], words: Words) -> tuple[scpi.Command, ...]:
    """Declare ranges, integration, averaging and relative values of every function.

    DEF is the top range (PyMeasure's suite for a connected DMM6500).
    """
    commands: list[scpi.Command] = [
        bandwidth_command(f"[SENSe:]{RANGED[name]}:DETector:BANDwidth", FILTERS, words.number)
        for name in ("VOLT:AC", "CURR:AC")
    ]
    for name in ("FREQ", "PER"):
        header = functions[name].header
        commands.append(gate_command(name, header, words.gates, (), words.number))
        commands += range_commands(functions[name], f"{header}:{words.threshold}", words.number)
    for name, header in RANGED.items():
        commands += range_commands(functions[name], header, words.number, functions[name].ranges[-1])
    cycles = scpi.Number(limits=words.cycles)
    commands += [
        integration(name, f"{functions[name].header}:NPLCycles", cycles, words.number, lambda _meter: 1.0)
        for name in words.integrating
    ]
    for name in (*RANGED, "TEMP", *words.more):
        header, path = f"[SENSe:]{functions[name].header}:AVERage", f"kept[{name}]"
        commands += [
            scpi.attribute(f"{header}[:STATe]", scpi.Boolean(), f"{path}.average", scpi.boolean),
            scpi.attribute(f"{header}:TCONtrol", scpi.Choice(("REPeat", "MOVing")), f"{path}.averaging"),
            scpi.attribute(
                f"{header}:COUNt", scpi.Integer(limits=scpi.Limits(1, 100)), f"{path}.count", scpi.signed_integer
            ),
        ]
    for name in (*RANGED, "TEMP", "FREQ", "PER", *words.more):
        header = f"[SENSe:]{functions[name].header}:{words.relative}"
        commands += [
            scpi.attribute(
                header, scpi.Number(limits=scpi.Limits(-1e9, 1e9, 0.0)), f"nulls[{name}].value", words.number
            ),
            scpi.attribute(f"{header}:STATe", scpi.Boolean(), f"nulls[{name}].on", scpi.boolean),
            scpi.Command(f"{header}:ACQuire", do=_acquire(name)),
        ]
    return tuple(commands)
