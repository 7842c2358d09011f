from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from vcfbench.drivers import replies
from vcfbench.errors import FramingError, MeasurementError

FINITE = st.floats(allow_nan=False, allow_infinity=False)
BELOW_OVERLOAD = FINITE.filter(lambda value: abs(value) < replies.OVERLOAD)


@given(BELOW_OVERLOAD)
def test_numbers_come_back_in_every_form(value: float) -> None:
    assert replies.number(repr(value)) == value
    assert replies.number(f"{value:+.16E}") == value


@given(BELOW_OVERLOAD)
def test_readings_below_overload_come_back(value: float) -> None:
    assert replies.reading(f"{value:+.16E}") == value


@given(FINITE.filter(lambda value: abs(value) >= replies.OVERLOAD))
def test_overloads_never_come_back(value: float) -> None:
    with pytest.raises(MeasurementError):
        replies.reading(repr(value))
    with pytest.raises(FramingError):
        replies.number(repr(value))
    with pytest.raises(FramingError):
        replies.numbers(f"1,{value!r},2")


@pytest.mark.parametrize("infinite", ["9.9E37", "+9.9000000000000000E+37", "9.8999999999999999E+37", "1e400"])
def test_a_load_alone_may_be_infinite(infinite: str) -> None:
    assert replies.ohms(infinite) == math.inf
    with pytest.raises(FramingError):
        replies.ohms(f"-{infinite.removeprefix('+')}")


@given(st.text(CHARACTERS))
def test_what_reads_as_a_number_is_one(text: str) -> None:
    try:
        value = replies.number(text)
    except FramingError:
        return
    assert set(text) <= set("+-.0123456789eE")
    assert value == float(text)
    assert not math.isnan(value)


@pytest.mark.parametrize(
    "text", ["", " ", "nan", "inf", "1e", "1 ", " 1", "1_0", "0x1", "1,2", "+", ".", "e5", "\u0661"]
)
def test_what_is_no_number(text: str) -> None:
    with pytest.raises(FramingError, match="expected a number"):
        replies.number(text)


@given(BELOW_OVERLOAD.filter(lambda value: value == 0.0 or abs(value) > 1e-99), st.integers(1, 16))
def test_fixed_form_refuses_a_character_more_or_less(value: float, decimals: int) -> None:
    form, reply = replies.nr3(decimals), f"{value:+.{decimals}E}"
    assert replies.reading(reply, form) == float(reply)
    for place in range(len(reply)):
        for spoiled in (reply[:place] + reply[place + 1 :], reply[: place + 1] + reply[place:]):
            with pytest.raises(FramingError, match="expected a number of the form"):
                replies.reading(spoiled, form)


@given(st.binary())
def test_text_is_printable_ascii_or_refused(data: bytes) -> None:
    try:
        text = replies.text(data)
    except FramingError:
        return
    assert text.isascii()
    assert text.isprintable()
    assert data.startswith(text.encode())


@given(st.binary(max_size=300), st.integers(min_value=1, max_value=9))
def test_block_headers_are_read_from_any_part(data: bytes, digits: int) -> None:
    header = f"#{digits}{len(data):0{digits}d}"
    if len(header) != 2 + digits:
        return  # the length does not fit so few digits
    whole = header.encode() + data
    for cut in range(len(whole) + 1):
        found = replies.block_length(whole[:cut])
        assert found == ((len(header), len(data)) if cut >= len(header) else None)


@given(st.binary(min_size=1, max_size=12))
def test_what_is_no_block_is_refused_or_waited_for(data: bytes) -> None:
    try:
        found = replies.block_length(data)
    except FramingError:
        return
    assert data[:1] == b"#"
    assert found is None or data[2 : found[0]].isdigit()


def test_block_length_takes_only_ascii_digits() -> None:
    with pytest.raises(FramingError):
        replies.block_length(b"#2\xb2\xb3")


@given(st.integers(min_value=-999, max_value=999), st.text(st.characters(min_codepoint=32, max_codepoint=126)))
def test_error_entries_come_back(number: int, words: str) -> None:
    doubled = words.replace('"', '""')
    for form in ("{:+d},", "{:d}, ", "{:d} ,", "{:+.5f},", "{:d}.,", "{:+d}.00E+00, "):
        assert replies.error_entry(form.format(number) + f'"{doubled}"') == (number, words)


@pytest.mark.parametrize("text", ["", "0", "+0,No error", '0,"No error', '0.5,"a"', '1E1,"a"', 'x,"y"', '0,"a"b"'])
def test_what_is_no_error_entry(text: str) -> None:
    with pytest.raises(FramingError):
        replies.error_entry(text)


def test_switches_integers_strings_identities() -> None:
    assert (replies.boolean("1"), replies.boolean("0")) == (True, False)
    assert (replies.integer("+1"), replies.integer("-20"), replies.integer("7")) == (1, -20, 7)
    assert replies.numbers("+0, 1.5,-2E1") == (0.0, 1.5, -20.0)
    assert replies.identity_fields("A, B,C,1.0,2") == ("A", "B", "C", "1.0,2")


@pytest.mark.parametrize("text", ["2", "", "ON", "+1", "01"])
def test_what_is_no_switch(text: str) -> None:
    with pytest.raises(FramingError):
        replies.boolean(text)


@pytest.mark.parametrize(("read", "text"), [("integer", "1.0"), ("identity_fields", "A,B,C")])
def test_what_is_none_of_them(read: str, text: str) -> None:
    with pytest.raises(FramingError):
        getattr(replies, read)(text)


ITEMS = st.one_of(
    st.binary(max_size=300).map(lambda data: b"#%d%d" % (len(str(len(data))), len(data)) + data),
    st.text("abc 019.+-E#:?", max_size=20).map(str.encode).filter(lambda text: not text.startswith(b"#")),
    st.text("abc;,# 0", max_size=10).map(lambda text: b'"' + text.encode() + b'"'),
)


@given(st.lists(ITEMS, min_size=1, max_size=5), st.sampled_from([b",", b";"]))
def test_answers_end_with_their_newline_whatever_blocks_and_strings_hold(items: list[bytes], separator: bytes) -> None:
    answer = separator.join(items) + b"\n"
    assert replies.is_whole(answer, ended=False)
    assert not any(replies.is_whole(answer[:size], ended=False) for size in range(len(answer)))
    assert replies.is_whole(answer[:-1], ended=True)


@pytest.mark.parametrize("text", [b"#0abc\n", b"#\n", b"#3x1\n", b"#x,1\n"])
def test_what_only_begins_like_a_block_ends_with_its_line(text: bytes) -> None:
    assert replies.is_whole(text, ended=False)
