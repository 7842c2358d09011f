"""Headers: every spelling the manual allows is accepted, every other refused."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.instruments.e3631a import E3631ATwin
from simrack.instruments.hp34401a import Hp34401ATwin
from simrack.scpi import Command, CommandTable, Mnemonic

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.scpi.lamp import TABLE, Lamp

if TYPE_CHECKING:
    from collections.abc import Callable

SPELLINGS = ("{}", "SOUR:{}", "SOURCE:{}")
LEVELS = ("", ":LEV", ":LEVEL")
TAILS = ("", ":IMM", ":IMMEDIATE", ":AMPL", ":AMPLITUDE", ":IMM:AMPL", ":IMMEDIATE:AMPL", ":IMM:AMPLITUDE")


def talk() -> Conversation:
    lamp = Lamp()
    return Conversation(lamp, lamp.clock)


@pytest.mark.parametrize("spell", [str.upper, str.lower, str.title])
def test_every_short_long_and_optional_form(spell: Callable[[str], str]) -> None:
    conversation = talk()
    for prefix, word, level, tail in product(SPELLINGS, ("VOLT", "VOLTAGE"), LEVELS, TAILS):
        header = spell(prefix.format(word) + level + tail)
        assert conversation.ask(f":{header} 2.5;:{header}?") == "+2.50000000E+00", header
        assert conversation.ask(f"{header} 1.5;:{header}?") == "+1.50000000E+00", header
    assert conversation.errors() == []


@given(st.text(alphabet="VOLTAGEvoltage", min_size=1, max_size=12))
def test_no_other_abbreviation(word: str) -> None:
    conversation = talk()
    expected = [] if word.upper() in ("VOLT", "VOLTAGE") else [-113]
    assert conversation.refusals(f"{word} 1") == expected


@given(st.sampled_from(["VOLTage", "SOURce", "IMMediate", "ISUMmary<1-3>", "TRACk"]), st.data())
def test_a_mnemonic_is_its_short_or_its_long_form(text: str, data: st.DataObject) -> None:
    mnemonic = Mnemonic.parse(text)
    cut = data.draw(st.integers(1, len(mnemonic.long)))
    word = mnemonic.long[:cut]
    assert (mnemonic.match(word) is not None) == (word in (mnemonic.short, mnemonic.long))


@pytest.mark.parametrize(
    ("message", "numbers"),
    [
        ("VOL 1", [-113]),
        ("VOLTAG 1", [-113]),
        ("SOUR VOLT 1", [-113]),
        ("FREQUENCYFREQUENCY 1", [-112]),
        ("VOLT:LEVELLEVELLEVEL 1", [-112]),
        ("SLOW 1", [-113]),
        ("FREQ?", [-113]),
        ("VOLT,1", [-103]),
        ("VOLT 1 2", [-103]),
        ("VOLT ,1", [-102]),
        ("VOLT 1,", [-102]),
        ("VOLT : LEV 1", [-102]),
        ("VOLT: LEV 1", [-102]),
        ("VOLT#DC", [-101]),
        ("FOO#DC", [-101]),
        ("FOO,1", [-103]),
        ("FOO 1,,2", [-113]),
        ("CODE \xb2", [-101]),
        ("DATA #\xb2ab", [-101]),
        ("OUTP #ON", [-101]),
        ("VOLT $1", [-101]),
        ("VOLT 1%", [-131]),
        ("CHAN5:LAB 'a'", [-114]),
        ("CHAN0:LAB?", [-114]),
        ("VOLT2 1", [-113]),
        ("*FOO", [-113]),
        ("VOLT", [-109]),
        ("VOLT 1,2", [-108]),
        ("*RST 1", [-108]),
        ("SLOW? 1", [-108]),
    ],
)
def test_refused_headers_and_separators(message: str, numbers: list[int]) -> None:
    assert talk().refusals(message) == numbers


@pytest.mark.parametrize(
    ("message", "reply"),
    [
        ("VOLT:LEV 3;STEP?", "+5.000E-001"),
        ("SOUR:VOLT 3;:VOLT?", "+3.00000000E+00"),
        ("VOLT:STEP 1;*OPC;STEP?", "+5.000E-001"),
        ("VOLT 3; VOLT?; *OPC?", "+3.00000000E+00;1"),
        ("VOLT 30 E -1;VOLT?", "+3.00000000E+00"),
        ("\x01VOLT\x00\x1f3\t V\r;VOLT?", "+3.00000000E+00"),
        ("VOLT 3;;VOLT?;", "+3.00000000E+00"),
        ("CHAN3:LAB?;LAB?", "+3;+3"),
        ("CHAN:LAB?;:CHANNEL4:LABEL?", "+1;+4"),
    ],
)
def test_paths_in_compound_messages(message: str, reply: str) -> None:
    conversation = talk()
    assert conversation.ask(message) == reply
    assert conversation.errors() == []


def test_the_path_ends_with_the_message_and_at_a_colon() -> None:
    conversation = talk()
    assert conversation.refusals("SOUR:VOLT 3;FREQ 1") == [-113]
    assert conversation.refusals("STEP 3") == [-113]
    assert conversation.refusals("SOUR:VOLT 3;:FREQ 1") == []


def test_commands_before_error_are_done_and_later_ones_skipped() -> None:
    conversation = talk()
    assert conversation.refusals("VOLT 2;FOO;VOLT 3") == [-113]
    assert conversation.ask("VOLT?") == "+2.00000000E+00"


def test_an_execution_error_does_not_end_the_message() -> None:
    conversation = talk()
    assert conversation.refusals("VOLT 7;VOLT 3") == [-222]
    assert conversation.ask("VOLT?") == "+3.00000000E+00"


def test_a_header_declared_twice_is_a_mistake_of_the_table() -> None:
    once = Command("VOLTage[:LEVel]", query=lambda _: 1)
    with pytest.raises(ValueError, match="declared twice"):
        CommandTable(once, Command("[SOURce:]VOLTage", query=lambda _: 2))


@pytest.mark.parametrize("table", [TABLE, E3631ATwin.table, Hp34401ATwin.table], ids=["lamp", "E3631A", "34401A"])
def test_every_declared_header_is_understood_in_every_spelling(table: CommandTable) -> None:
    """Both forms of all nodes, every choice of optional nodes: compiled without -113 or -114."""
    for command in table.commands:
        for choice in product(*([there, ()] if optional else [there] for there, optional in command.parts())):
            for spelling in product(*(mnemonic.spellings for nodes in choice for mnemonic in nodes)):
                header = ":".join(spelling) + ("" if command.do else "?")
                (step,) = table.compile(header)
                assert step.error is None or step.error.number == -109, header
