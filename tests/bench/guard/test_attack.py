"""What the guard lets through is said to a simulated instrument: no words bring it beyond the limits."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.instruments.e3631a import E3631ATwin, SupplyErrors
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.fake_world import FakeWorld

from vcfbench.bench.file import load_bench
from vcfbench.bench.guard import guard_of
from vcfbench.clock import VirtualClock
from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription

MAX_V = 3.0
PAPER = load_bench("paper")  # rails 9.5 ... 10.5 V, 0.2 A
BENCH = structs.replace(PAPER, limits=structs.replace(PAPER.limits, max_v_vc_v=MAX_V))

SPELLED = {
    "VOLT": ("VOLT", "voltage", "SOUR:VOLT", ":SOURce:VOLTage:LEVel:IMMediate:AMPLitude", "VOLT:AMPL", "volt:lev"),
    "OFFS": ("VOLT:OFFS", "SOURCE:VOLTAGE:OFFSET", "VOLT:LEV:IMM:OFFS"),
    "HIGH": ("VOLT:HIGH", "VOLT:LEVEL:HIGH"),
    "LOW": ("VOLT:LOW", "sour:volt:low"),
    "LOAD": ("OUTP:LOAD", "OUTPut:LOAD"),
    "OUTP": ("OUTP", "OUTPUT:STATE"),
    "FUNC": ("FUNC", "SOUR:FUNCTION"),
    "UNIT": ("VOLT:UNIT", "SOURce:VOLTage:UNIT"),
}
NUMBER = st.one_of(
    st.floats(-12.0, 12.0).map(lambda value: f"{value:.4g}"),
    st.sampled_from(["0", "1", "2", "2.9", "3", "3.1", "5.9", "6.1", "MIN", "MAX", "DEF", "+1.5E0", ".5e1"]),
)


def one_of(name: str) -> st.SearchStrategy[str]:
    return st.sampled_from(SPELLED[name])


def command(name: str, *arguments: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.tuples(one_of(name), *arguments).map(lambda parts: f"{parts[0]} {''.join(parts[1:])}")


UNITS = st.sampled_from(["", "", " V", " VPP", " VRMS", " MV", " MVPP", " DBM"])
FUNCTIONS = st.sampled_from(["SIN", "SQU", "RAMP", "PULS", "NOIS", "DC", "USER", "sinusoid"])
GENERATOR = st.one_of(
    command("VOLT", NUMBER, UNITS),
    command("OFFS", NUMBER, UNITS),
    command("HIGH", NUMBER),
    command("LOW", NUMBER),
    command("LOAD", st.sampled_from(["50", "INF", "MIN", "MAX", "1000", "DEF"])),
    command("OUTP", st.sampled_from(["ON", "1", "OFF"])),
    command("FUNC", FUNCTIONS),
    command("UNIT", st.sampled_from(["VPP", "VRMS", "DBM"])),
    st.tuples(FUNCTIONS, NUMBER, UNITS, NUMBER).map(lambda p: f"APPL:{p[0]} 1000,{p[1]}{p[2]},{p[3]}"),
    st.tuples(FUNCTIONS, NUMBER).map(lambda p: f"APPLY:{p[0]} DEF,{p[1]}"),
    st.sampled_from(["*RST", "FREQ 3488.9", "AM:STAT ON", "BURS:STAT ON", "VOLT:RANG:AUTO OFF", "APPL:SIN", "VOLT?"]),
)
OUTPUTS = st.sampled_from(["P6V", "P25V", "N25V"])
SUPPLY_LEVEL = st.one_of(
    st.floats(-26.0, 26.0).map(lambda value: f"{value:.4g}"),
    st.sampled_from(["0", "10", "-10", "9.5", "10.5", "10.6", "-9.6", "MIN", "MAX", "DEF", "1E1", "10 V", "9800 MV"]),
)
AMPERES = st.sampled_from(["0.1", "0.2", "0.3", "1", "MIN", "MAX", "DEF", "100 MA", "2E-1", "250MA"])
SUPPLY = st.one_of(
    command("VOLT", SUPPLY_LEVEL),
    AMPERES.map(lambda value: f"CURR {value}"),
    st.tuples(OUTPUTS, SUPPLY_LEVEL, AMPERES).map(lambda p: f"APPL {p[0]},{p[1]},{p[2]}"),
    st.tuples(OUTPUTS, SUPPLY_LEVEL).map(lambda p: f"apply {p[0]},{p[1]}"),
    OUTPUTS.map(lambda name: f"INST:SEL {name}"),
    st.sampled_from(
        ["INST P25V", "INST:NSEL 1", "INST:NSEL 2", "INST:NSEL 3", "OUTP ON", "OUTP 1", "OUTP OFF", "*RST"]
    ),
    st.sampled_from(
        ["OUTP:TRAC ON", "OUTP:TRAC OFF", "VOLT:TRIG 12", "INIT", "*TRG", "*SAV 1", "*RCL 1", "APPL? N25V"]
    ),
)


def messages(commands: st.SearchStrategy[str]) -> st.SearchStrategy[list[str]]:
    compound = st.lists(st.tuples(commands, st.sampled_from([";", ";:", " ; :"])), min_size=1, max_size=4)
    joined = compound.map(lambda parts: "".join(text.lstrip(":") + mark for text, mark in parts).rstrip("; :"))
    return st.lists(joined, min_size=1, max_size=6)


class Guarded:
    """An instrument to which only those messages get that its guard lets through."""

    def __init__(self, role: str, talk: Conversation, bench: BenchDescription) -> None:
        self.talk = talk
        self._guard = guard_of(role, bench)

    def say(self, message: str) -> None:
        with suppress(LimitError):
            self._guard.judge(message, self.ask)
            self.talk.write(message)
        self.talk.settle()
        while self.talk.read(0.0) is not None:  # answers of questions within
            pass
        self.talk.write("*CLS")
        self.talk.settle()

    def ask(self, question: str) -> str:
        answer = self.talk.ask(question)
        assert answer is not None, question
        return answer


class NoPcb:
    def __init__(self) -> None:
        self.clock = VirtualClock()

    def drive(self, node: str, source: object) -> None: ...


def peak_v(guarded: Guarded) -> float:
    """The highest voltage of the generator's setting into an open circuit, as its high and low level say."""
    load_ohm = float(guarded.ask("OUTP:LOAD?"))
    factor = 1.0 if load_ohm > 1e30 else (load_ohm + 50.0) / load_ohm
    if guarded.ask("FUNC?") == "DC":
        return factor * abs(float(guarded.ask("VOLT:OFFS?")))
    return factor * max(abs(float(guarded.ask("VOLT:HIGH?"))), abs(float(guarded.ask("VOLT:LOW?"))))


@settings(max_examples=100, deadline=None)
@given(messages(GENERATOR))
def test_no_words_make_the_generator_exceed_the_limit(typed: list[str]) -> None:
    world = NoPcb()
    guarded = Guarded("rate_source", Conversation(Agilent33220ATwin(world, GeneratorErrors.none()), world.clock), BENCH)
    for message in typed:
        guarded.say(message)
        assert peak_v(guarded) <= MAX_V * (1 + 1e-3), message  # settings are rounded to four digits


@settings(max_examples=100, deadline=None)
@given(messages(SUPPLY))
def test_no_words_make_the_supply_leave_the_rails(typed: list[str]) -> None:
    world = FakeWorld()
    supply = E3631ATwin(world, errors=SupplyErrors.none(), interface="gpib")  # type: ignore[arg-type]
    world.clock.attend(supply)
    guarded = Guarded("power", Conversation(supply, world.clock), BENCH)
    for message in typed:
        guarded.say(message)
        for name, sign in (("P6V", 0.0), ("P25V", 1.0), ("N25V", -1.0)):
            volts, amps = (float(text) for text in guarded.ask(f"APPL? {name}").strip('"').split(","))
            inside = sign != 0.0 and 9.5 <= sign * volts <= 10.5
            assert volts == 0.0 or inside, message
            if volts and guarded.ask("OUTP?") == "1":
                assert amps <= 0.2, message


@pytest.mark.parametrize(
    "message",
    [
        "VOLT:UNIT VRMS;:VOLT 2.9",  # a sine of 8.2 Vpp
        "VOLT:UNIT VRMS;:APPL:SIN 1000,2.5,0",
        "VOLT:UNIT DBM;:VOLT MAX",
        "APPL:DC DEF,0.1,1;:FUNC SIN;:VOLT:OFFS 2.9",
        "*RST;:VOLT 0;:VOLT:LOW 1.5",
    ],
)
def test_a_unit_that_is_changed_on_the_way_counts(message: str) -> None:
    world = NoPcb()
    guarded = Guarded("rate_source", Conversation(Agilent33220ATwin(world, GeneratorErrors.none()), world.clock), BENCH)
    guarded.say("OUTP:LOAD INF;:VOLT 5")
    guarded.say(message)
    assert peak_v(guarded) <= MAX_V * (1 + 1e-3)
