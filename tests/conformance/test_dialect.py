"""Twenty-four expectations of SCPI-99 and IEEE 488.2, put to every instrument that has a level in volts.

It is the list that other simulators were asked too, so that all can be compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.conformance import walk

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.conformance.walk import Bench

LEVELS = {
    "e3631a": ("VOLT", "VOLTAGE"),
    "agilent33220a": ("VOLT", "VOLTAGE"),
    "dso7104b": ("CHAN1:SCAL", "CHANNEL1:SCALE"),
}
"""A settable level with a range; short and long header."""

REFUSED = {
    ("dso7104b", "query MAX"): "oscilloscopes of this maker take no MIN and MAX (none of the sources has them)",
    ("dso7104b", "long SYSTem:ERRor:NEXT?"): "the sources have SYSTem:ERRor? only",
}
"""What a model is not expected to know."""


def near(wanted: float) -> Callable[[str], bool]:
    return lambda reply: abs(float(reply) - wanted) < 1e-6


def numbered(*wanted: int) -> Callable[[str], bool]:
    return lambda reply: int(reply.partition(",")[0]) in wanted


EXPECTATIONS: list[tuple[str, list[str], Callable[[str], bool]]] = [
    ("short form", ["{short} 1.5", "{short}?"], near(1.5)),
    ("long form", ["{long} 1.6", "{short}?"], near(1.6)),
    ("lower case", ["{lower} 1.7", "{short}?"], near(1.7)),
    ("leading colon", [":{short} 1.8", "{short}?"], near(1.8)),
    ("an abbreviation in between is refused", ["*CLS", "{short}A 1.9", "SYST:ERR?"], numbered(-113, -114)),
    ("two units in one line", ["{short} 2.1;:{short}?"], near(2.1)),
    ("unit suffix V", ["{short} 2.2 V", "{short}?"], near(2.2)),
    ("unit suffix mV", ["{short} 2300 MV", "{short}?"], near(2.3)),
    ("exponent", ["{short} 2.4E0", "{short}?"], near(2.4)),
    ("MAXimum", ["{short} MAX", "{short}?"], lambda reply: float(reply) > 2.4),
    ("query MAX", ["{short}? MAX"], lambda reply: float(reply) > 2.4),
    ("undefined header queues -113", ["*CLS", "NONS:ENSE 1", "SYST:ERR?"], numbered(-113)),
    ("out of range queues -222", ["*CLS", "{short} 1E6", "SYST:ERR?"], numbered(-222)),
    ("missing parameter queues -109", ["*CLS", "{short}", "SYST:ERR?"], numbered(-109)),
    ("data type error is queued", ["*CLS", '{short} "x"', "SYST:ERR?"], numbered(-104, -128, -158)),
    ("empty queue", ["*CLS", "SYST:ERR?"], lambda reply: reply == '+0,"No error"'),
    ("long SYSTem:ERRor:NEXT?", ["*CLS", "SYSTEM:ERROR:NEXT?"], numbered(0)),
    ("*OPC?", ["*OPC?"], lambda reply: reply.strip() == "1"),
    ("*ESR? shows a command error", ["*CLS", "*ESR?", "NONS:ENSE 1", "*ESR?"], lambda reply: bool(int(reply) & 32)),
    ("*ESR? clears", ["*CLS", "NONS:ENSE 1", "*ESR?", "*ESR?"], lambda reply: int(reply) == 0),
    ("*STB?", ["*STB?"], lambda reply: reply.strip().lstrip("+").isdigit()),
    ("*TST?", ["*TST?"], lambda reply: int(reply) == 0),
    ("*RST restores the default", ["{short} 2.5", "*RST", "{short}?"], lambda reply: float(reply) != 2.5),
    ("overflow of the queue", ["*CLS", *["NONS:ENSE 1"] * 60, *["SYST:ERR?"] * 30], bool),
]


def said(bench: Bench, lines: list[str], names: dict[str, str]) -> list[str]:
    replies = []
    for line in lines:
        message = line.format(**names)
        bench.write(message)
        if "?" in message:
            replies.append(bench.read() or "")
    return replies


def test_there_are_twenty_four() -> None:
    assert len(EXPECTATIONS) == 24


def test_the_supply_answers_all_of_them_to_the_character() -> None:
    assert not [name for model, name in REFUSED if model == "e3631a"]
    bench = walk.bench("e3631a")
    assert bench.ask("*STB?") == "0"
    assert bench.ask("*TST?") == "0"


@pytest.mark.parametrize("model", LEVELS)
def test_dialect(model: str) -> None:
    short, long = LEVELS[model]
    for name, lines, verdict in EXPECTATIONS:
        if (model, name) not in REFUSED:
            replies = said(walk.bench(model), lines, {"short": short, "long": long, "lower": short.lower()})
            assert name != "overflow of the queue" or any(reply.startswith("-350") for reply in replies)
            assert verdict(replies[-1]), (name, replies[-1])
