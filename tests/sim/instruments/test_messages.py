"""Messages of many units, quick ones and such as take time: the answers come in order, in one response."""

from __future__ import annotations

import re
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.messages import UNITS, Unit, answers, errors, messages, text, wrong_messages

from vcfbench.clock import VirtualClock
from vcfbench.sim.builder import SimulatedBench
from vcfbench.testing import simulated

NUMBER = r"[-+]\d\.\d{8}E[-+]\d\d"
COMPOUNDS = [
    ("MEAS:VOLT?;*OPC?", f"{NUMBER};1"),
    ("MEAS:VOLT?;:SYST:ERR?", rf'{NUMBER};\+0,"No error"'),
    ("*OPC?;:MEAS:VOLT?", f"1;{NUMBER}"),
    ("MEAS:VOLT?;:MEAS:RES?", f"{NUMBER};{NUMBER}"),
    ("VOLT:RANG 10;:MEAS:VOLT?;:VOLT:RANG?", rf"{NUMBER};\+1\.00000000E-01"),
    ("MEAS:VOLT?;:READ?", f"{NUMBER};{NUMBER}"),
]


@cache
def _bench() -> SimulatedBench:
    return SimulatedBench.build(simulated(parameters="ideal", errors="none"), 1, VirtualClock())


def _talk(role: str) -> Conversation:
    bench = _bench()
    bench.devices[role].clear()
    talk = Conversation(bench.devices[role], bench.clock)
    assert talk.ask("*RST;*CLS;*OPC?")
    return talk


def _errors(talk: Conversation) -> list[int]:
    """Empty the error queue, without waiting for an oscilloscope that runs to come to an end."""
    numbers: list[int] = []
    while number := int((talk.ask("SYST:ERR?") or "0").partition(",")[0]):
        numbers.append(number)
    return numbers


@pytest.mark.parametrize(("message", "answer"), COMPOUNDS)
def test_a_measurement_is_answered_in_its_place(message: str, answer: str) -> None:
    talk = _talk("multimeter")
    assert re.fullmatch(answer, talk.ask(message) or "")
    assert _errors(talk) == []


@pytest.mark.parametrize("mistake", ["FOO", ":FOO", "VOLT:RANG", "MEAS:VOLT? 1,2,3"])
@pytest.mark.parametrize("query", ["MEAS:VOLT:DC?", "MEAS:RES?", "READ?", "*OPC?;:MEAS:VOLT?"])
def test_an_error_after_a_measurement_costs_no_answer(query: str, mistake: str) -> None:
    talk = _talk("multimeter")
    assert (talk.ask(f"{query};{mistake}") or "").count(";") == query.count(";")
    assert len(_errors(talk)) == 1


@pytest.mark.parametrize("role", UNITS)
@settings(max_examples=25)
@given(data=st.data())
def test_any_queries_are_answered_in_order_in_one_message(role: str, data: st.DataObject) -> None:
    _hold(role, data.draw(messages(role)))


@pytest.mark.parametrize("role", UNITS)
@settings(max_examples=25)
@given(data=st.data())
def test_error_ends_message_and_keeps_earlier_answers(role: str, data: st.DataObject) -> None:
    _hold(role, data.draw(wrong_messages(role)))


def _hold(role: str, units: list[Unit]) -> None:
    talk = _talk(role)
    expected = answers(units)
    talk.write(text(units))
    if expected is not None:
        assert re.fullmatch(expected, talk.read() or "")
    assert _errors(talk) == errors(units)
