from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.bench.guard.message import (
    AMPERE,
    VOLT,
    VPP,
    MessagePart,
    Unreadable,
    header_pattern,
    quantity,
    read_message,
    switch,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("VOLT 5", [("VOLT", False, ("5",))]),
        ("*IDN?", [("*IDN", True, ())]),
        ("SOUR:VOLT 5;CURR 1", [("SOUR:VOLT", False, ("5",)), ("SOUR:CURR", False, ("1",))]),
        ("SOUR:VOLT 5;*CLS;CURR 1", [("SOUR:VOLT", False, ("5",)), ("*CLS", False, ()), ("SOUR:CURR", False, ("1",))]),
        (
            "volt:offs 1 V;:OUTP? ;outp on",
            [("VOLT:OFFS", False, ("1 V",)), ("OUTP", True, ()), ("OUTP", False, ("on",))],
        ),
        ("APPL P25V, 10 ,0.1", [("APPL", False, ("P25V", "10", "0.1"))]),
        ("DISP:TEXT 'a;b, c'", [("DISP:TEXT", False, ("'a;b, c'",))]),
        (
            ":Demand:Rate 1,1.5;Position 1,2",
            [("DEMAND:RATE", False, ("1", "1.5")), ("DEMAND:POSITION", False, ("1", "2"))],
        ),
        (" ; ;", []),
    ],
)
def test_commands_with_their_whole_paths(text: str, expected: list[tuple[str, bool, tuple[str, ...]]]) -> None:
    assert [(part.path, part.query, part.arguments) for part in read_message(text)] == expected


@pytest.mark.parametrize(
    "text",
    ["VOLT 5\nOUTP ON", "VOLT\x00", "VOLT °", "DISP:TEXT 'a", "DATA #15hello", "5 VOLT", "VOLT: 5", "::VOLT", "?"],
)
def test_what_is_not_understood_is_never_guessed(text: str) -> None:
    with pytest.raises(Unreadable):
        read_message(text)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        parts = read_message(text)
    except Unreadable:
        return
    assert all(part.path == part.path.upper() and part.path for part in parts)
    assert all("\n" not in argument for part in parts for argument in part.arguments)


@pytest.mark.parametrize(
    ("spelling", "right", "wrong"),
    [
        (
            "[SOURce:]VOLTage[:LEVel]",
            "VOLT VOLTAGE SOUR:VOLT SOURCE:VOLTAGE:LEV VOLT:LEVEL",
            "VOLTA SOURC:VOLT LEV VOLT:",
        ),
        ("DISPlay...", "DISP DISPLAY:TEXT DISP:WIND:TEXT:CLE", "DISPL DISPLAYER"),
        ("*RST", "*RST", "RST *RSTX"),
    ],
)
def test_exactly_the_short_or_the_long_form(spelling: str, right: str, wrong: str) -> None:
    pattern = header_pattern(spelling)
    assert [word for word in right.split() if not pattern.fullmatch(word)] == []
    assert [word for word in wrong.split() if pattern.fullmatch(word)] == []


@pytest.mark.parametrize(
    ("text", "units", "value"),
    [
        ("5", VOLT, 5.0),
        ("+.5e1 V", VOLT, 5.0),
        ("-500 mV", VOLT, -0.5),
        ("5MV", VOLT, 0.005),
        ("100ma", AMPERE, 0.1),
        ("3 VPP", VPP, 3.0),
        ("max", VOLT, 7.0),
        ("MAXIMUM", VOLT, 7.0),
    ],
)
def test_numbers_with_their_units(text: str, units: dict[str, float], value: float) -> None:
    assert quantity(text, units, {"MAXimum": 7.0}) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["", "MAXI", "5 A", "5 VRMS", "1e999", "nan", "inf", "0x10", "#HFF", "5 5", "UP", "\u0661"]
)
def test_what_is_no_number_in_that_unit(text: str) -> None:
    with pytest.raises(Unreadable):
        quantity(text, VOLT, {"MAXimum": 7.0})


def test_switches() -> None:
    assert [switch(text) for text in ("ON", "off", "1", "0")] == [True, False, True, False]
    with pytest.raises(Unreadable):
        switch("2")


def test_parameters_are_counted() -> None:
    with pytest.raises(Unreadable, match="VOLT takes 1 parameters, not 2"):
        MessagePart("VOLT", query=False, arguments=("1", "2")).require(1)
    with pytest.raises(Unreadable, match="VOLT lacks a parameter"):
        MessagePart("VOLT", query=False, arguments=()).argument(0)
