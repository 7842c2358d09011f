"""Parameters: what is accepted, what it means, what is refused with which number."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.scpi import Dialect, Quantity, clip

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.scpi.lamp import Lamp


def talk(dialect: Dialect | None = None) -> tuple[Lamp, Conversation]:
    lamp = Lamp(dialect=dialect)
    return lamp, Conversation(lamp, lamp.clock)


@given(st.floats(0.0, 6.0, allow_subnormal=False))
def test_numbers_arrive_as_sent(level: float) -> None:
    lamp, conversation = talk()
    conversation.write(f"VOLT {level!r}")
    assert lamp.level == level


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1.0),
        ("+1.5", 1.5),
        (".5", 0.5),
        ("2.", 2.0),
        ("1E-1", 0.1),
        ("2e+0", 2.0),
        ("300 MV", 0.3),
        ("300MV", 0.3),
        ("5 uV", 5e-6),
        ("0.001 KV", 1.0),
        ("1V", 1.0),
        ("#H5", 5.0),
        ("#b101", 5.0),
        ("#Q5", 5.0),
        ("MIN", 0.0),
        ("MAXIMUM", 6.0),
        ("def", 1.0),
    ],
)
def test_spellings_of_a_number(text: str, value: float) -> None:
    lamp, conversation = talk()
    assert conversation.refusals(f"VOLT {text}") == []
    assert lamp.level == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(("text", "hertz"), [("1 KHZ", 1e3), ("1 MHZ", 1e6), ("1 MAHZ", 1e6), ("1 UHZ", 1e-6)])
def test_an_m_is_mega_before_hertz(text: str, hertz: float) -> None:
    lamp, conversation = talk()
    conversation.write(f"FREQ {text}")
    assert lamp.heard["frequency"] == (hertz,)


@pytest.mark.parametrize(("query", "reply"), [("VOLT? MIN", 0.0), ("VOLT? MAX", 6.0), ("VOLT? DEFAULT", 1.0)])
def test_limits_can_be_asked_for(query: str, reply: float) -> None:
    _, conversation = talk()
    assert float(conversation.ask(query) or "nan") == reply


@pytest.mark.parametrize(
    ("message", "numbers"),
    [
        ("VOLT 7", [-222]),
        ("VOLT -0.1", [-222]),
        ("VOLT 3 S", [-131]),
        ("PLAI 1 V", [-138]),
        ("COUN 1 SEC", [-138]),
        ("FREQ 1 HZHZHZHZHZHZHZHZ", [-134]),
        ("VOLT ABC", [-224]),
        ("PLAI ABC", [-148]),
        ("VOLT 'a'", [-158]),
        ("VOLT #13abc", [-168]),
        ("VOLT (@1)", [-178]),
        ("VOLT (1", [-171]),
        ("*ESE #B01010102", [-121]),
        ("*ESE #HXYZ", [-121]),
        ("VOLT 1.2.3", [-121]),
        ("VOLT --1", [-121]),
        ("VOLT 1E40000", [-123]),
        ("PLAI " + "1" * 256, [-124]),
        ("*ESE 256", [-222]),
        ("SHAP FOO", [-224]),
        ("SHAP 1", [-128]),
        ("SHAP 'SIN'", [-158]),
        ("SHAP SINUSOIDSINUSOID", [-144]),
        ("OUTP MAYBE", [-224]),
        ("OUTP 'ON'", [-158]),
        ("TEXT 'ON", [-151]),
        ("TEXT ON", [-148]),
        ("TEXT 5.0", [-128]),
        ("TEXT 'thirteen char'", [-223]),
        ("DATA #15abc", [-161]),
        ("DATA 'a'", [-158]),
        ("CODE 3", [-128]),
        ("DIG CHAN5", [-224]),
        ("VOLT? HIGH", [-224]),
        ("VOLT? MIN,MAX", [-108]),
    ],
)
def test_refusals(message: str, numbers: list[int]) -> None:
    lamp, conversation = talk()
    assert conversation.refusals(message) == numbers
    assert lamp.level == 1.0
    assert not lamp.heard


def test_misplaced_number_has_the_error_of_its_model() -> None:
    _, conversation = talk(Dialect(number_not_allowed=-104))
    assert conversation.refusals("TEXT 5.0") == [-104]
    assert conversation.refusals("SHAP 1") == [-104]


@pytest.mark.parametrize(
    ("message", "level", "words"),
    [
        ("VOLT 7", 6.0, "Data out of range; level; value clipped to upper limit"),
        ("VOLT -1", 0.0, "Data out of range; level; value clipped to lower limit"),
    ],
)
def test_a_model_may_clip(message: str, level: float, words: str) -> None:
    lamp, conversation = talk(Dialect(out_of_range=clip))
    conversation.write(message)
    assert conversation.ask("SYST:ERR?") == f'-222,"{words}"'
    assert lamp.level == level


@given(st.text(alphabet=st.characters(min_codepoint=32, max_codepoint=126), max_size=12), st.sampled_from("'\""))
def test_strings_with_either_quote(text: str, quote: str) -> None:
    lamp, conversation = talk()
    assert conversation.refusals(f"TEXT {quote}{text.replace(quote, quote * 2)}{quote}") == []
    assert lamp.heard["text"] == (text,)


@given(st.binary(max_size=40))
def test_blocks_carry_any_byte(data: bytes) -> None:
    lamp, conversation = talk()
    length = str(len(data)).encode()
    lamp.write(b"DATA #%d%b" % (len(length), length) + data + b";VOLT 3\n", end=True)
    assert conversation.errors() == []
    assert lamp.heard["data"] == (data,)
    assert lamp.level == 3.0


def test_block_and_string_replies() -> None:
    lamp, conversation = talk()
    assert conversation.ask("TEXT?") == '"say ""it"""'
    lamp.write(b"DATA?\n", end=True)
    assert lamp.read(100) == (b"#800000016" + bytes(range(16)) + b"\n", True)


@pytest.mark.parametrize(("text", "state"), [("ON", True), ("off", False), ("1", True), ("0", False), ("0.4", False)])
def test_booleans(text: str, state: bool) -> None:  # noqa: FBT001
    lamp, conversation = talk()
    conversation.write(f"OUTP {text}")
    assert lamp.heard["output"] == (state,)
    assert conversation.ask("OUTP?") == "1"


def test_words_beside_the_usual() -> None:
    lamp, conversation = talk()
    conversation.write("OUTP ONCE;:COUN INF;:CODE hp034401;:SHAP square;:DIG CHAN2,channel3;:AMPL 3 VPP")
    assert conversation.errors() == []
    assert lamp.heard == {
        "output": ("ONCE",),
        "count": (math.inf,),
        "code": ("HP034401",),
        "shape": ("SQU",),
        "digitize": ("CHAN2", "CHAN3"),
        "amplitude": (Quantity(3.0, "VPP"),),
    }


@pytest.mark.parametrize(("sent", "legal"), [(0.02, 0.02), (0.5, 1.0), (3.0, 1.0), (4.0, 10.0), (50, 100.0)])
def test_discrete_numbers_are_rounded_not_refused(sent: float, legal: float) -> None:
    lamp, conversation = talk()
    assert conversation.refusals(f"CYCL {sent}") == []
    assert lamp.heard["cycles"] == (legal,)


@pytest.mark.parametrize(("sent", "count"), [("1.4", 1), ("2.5", 3), ("99.5", 100)])
def test_integers_are_rounded(sent: str, count: int) -> None:
    lamp, conversation = talk()
    conversation.write(f"COUN {sent}")
    assert lamp.heard["count"] == (count,)
