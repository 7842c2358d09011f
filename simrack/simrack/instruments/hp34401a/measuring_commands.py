"""MEASure, CONFigure, READ, INITiate, FETCh and FUNCtion of the 34401A (User's Guide p. 107-120)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from simrack.instruments.hp34401a.functions import APERTURES_S, BY_NAME, Function
from simrack.instruments.hp34401a.instrument import SimulatedHp34401A
from simrack.instruments.hp34401a.trigger import TriggerSequence, TriggerSystem
from simrack.scpi import RS232, Command, Number, Pending, Rows, ScpiError, Text, comma_list, quoted, real
from simrack.scpi.mnemonics import Mnemonic

ROWS = Rows()

_FUNCTION_CHANGE_S = 1 / 26
"""Function changes a second over the bus (p. 217)."""
_NR3 = real(8)
_READINGS = comma_list(_NR3)
_NO_WORDS: Mapping[str, float] = MappingProxyType({})


class _Readings:
    """Readings that go out while others are taken (p. 84)."""

    def __init__(self, triggering: TriggerSystem) -> None:
        self._triggering = triggering
        self.waiting = triggering.streams

    def take(self) -> bytes:
        """Return those that can go out, each with its comma; the last of all ends the answer."""
        return b"".join(_NR3(value).encode() + b"," for value in self._triggering.take_streamed())


def _running(meter: SimulatedHp34401A, sequence: TriggerSequence, finish: Callable[[], Any]) -> Pending:
    """Return a wait of the parser until `sequence` is through."""
    return Pending(lambda: meter.clock.now() if meter.triggering.sequence is not sequence else None, finish)


def _read(meter: SimulatedHp34401A) -> Pending:
    if meter.local and meter.engine.interface is RS232:
        raise ScpiError(550)
    if meter.triggering.source == "BUS":
        raise ScpiError(-214)
    sequence = meter.triggering.start(stored=False)
    running = _running(meter, sequence, lambda: sequence.readings)
    running.stream = _Readings(meter.triggering) if sequence.streamed else None
    return running


@ROWS.do("INITiate[:IMMediate]")
def _initiate(meter: SimulatedHp34401A) -> Pending:
    if meter.triggering.feed and meter.triggering.readings_to_come > meter.triggering.capacity:
        raise ScpiError(531)
    return _running(meter, meter.triggering.start(stored=True), lambda: None)


@ROWS.query("FETCh", reply=_READINGS)
def _fetch(meter: SimulatedHp34401A) -> list[float]:
    if not meter.triggering.memory:
        raise ScpiError(-230)
    return meter.triggering.memory


def _configuration(meter: SimulatedHp34401A) -> str:
    setup, function = meter.setup, meter.function
    gated = function.gated and not function.ranges
    resolution = function.slowest * APERTURES_S[setup.aperture_s] if gated else setup.range * setup.resolution
    range_ = function.slowest if function.gated else setup.range
    return f"{function.name} {_NR3(range_)},{_NR3(resolution)}"


def _function_named(meter: SimulatedHp34401A, text: str) -> Function:
    """Return the function a string names, in short or long forms, `:DC` being optional."""
    words = tuple(text.strip().upper().split(":"))
    for function in meter.functions.values():
        if any(_spells(words, spelling) for spelling in function.spellings):
            return function
    raise ScpiError(-224)


def _spells(words: tuple[str, ...], spelling: str) -> bool:
    nodes = [Mnemonic.parse(node) for node in spelling.split(":")]
    return len(nodes) == len(words) and all(word in node.spellings for word, node in zip(words, nodes, strict=True))


def measurement_commands(
    function: Function, read: Callable[[Any], Pending] = _read, words: Mapping[str, float] = _NO_WORDS
) -> tuple[Command, ...]:
    """Declare CONFigure and MEASure of one function: `[<range>[,<resolution>]]`.

    Args:
        function: the function.
        read: what READ? does.
        words: what may stand for the range besides MIN, MAX and DEF.
    """
    expected = Number(unit=function.unit, required=False, deferred=True, words=words)
    resolution = Number(unit=function.unit, required=False, deferred=True)
    parameters = () if function.name in ("CONT", "DIOD") else (expected, resolution)

    def configure(meter: SimulatedHp34401A, expected: Any = None, resolution: Any = None) -> None:
        meter.configure(function, expected, resolution)

    def measure(meter: SimulatedHp34401A, expected: Any = None, resolution: Any = None) -> Pending:
        meter.configure(function, expected, resolution)
        return read(meter)

    return (
        Command(f"CONFigure:{function.header}", parameters, do=configure, takes_s=_FUNCTION_CHANGE_S),
        Command(
            f"MEASure:{function.header}",
            query=measure,
            query_parameters=parameters,
            reply=_READINGS,
            query_takes_s=_FUNCTION_CHANGE_S,
        ),
    )


FUNCTION = Command(
    "[SENSe:]FUNCtion",
    (Text(),),
    do=lambda meter, name: meter.choose(_function_named(meter, name)),
    query=lambda meter: meter.function.name,
    reply=quoted,
    takes_s=_FUNCTION_CHANGE_S,
    reads=True,
)
CONFIGURATION = Command("CONFigure", query=_configuration, reply=quoted, reads=True)

COMMANDS = (
    *ROWS,
    # measuring
    *(command for function in BY_NAME.values() for command in measurement_commands(function)),
    CONFIGURATION,
    Command("READ", query=_read, reply=_READINGS),
    FUNCTION,
)
