from __future__ import annotations

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.rate_tables.acl.language import COMMANDS, AclRequest, BadCommand, parse_message


def one(text: str) -> AclRequest:
    (item,) = parse_message(text)
    assert isinstance(item, AclRequest), f"{text!r} was refused"
    return item


@pytest.mark.parametrize(
    ("text", "path"),
    [
        (":INT:CLOSe 1", "Interlock:Close"),
        (":I:C 1", "Interlock:Close"),
        (":INT:RES", "Interlock:Reset"),
        (":R:V? 3", "Read:Vector"),
        (":READ:SVEC? 6", "Read:ShortVector"),
        (":R:S? 2", "Read:ShortVector"),
        (":D:P 3,10.5", "Demand:Position"),
        (":dem:rate 1,0", "Demand:Rate"),
        (":DEM:ACCeleration 2,1000", "Demand:Acceleration"),
        (":DEM:DEL? 2", "Demand:DeltaPosition"),
        (":DEM:IVAR 7,100.8", "Demand:InputVariable"),
        (":LIM:ACC P,1,1500.0", "Limit:Acceleration"),
        (":LIM:VTR R,2,100.0", "Limit:Vtrip"),
        (":L:V? 2", "Limit:Vtrip"),
        (":LIM:HPOS? P,3", "Limit:HighPosition"),
        (":L:L? 2", "Limit:LowPosition"),
        (":L:R? T,2", "Limit:Rate"),
        (":M? 1", "Mode"),
        (":MODE:SYNT 1", "Mode:Synthesis"),
        (":M:O 2", "Mode:Off"),
        (":M:H 1", "Mode:Home"),
        (":U:L?", "Utility:Lockout"),
        (":U:F F", "Utility:Format"),
        (":Stat:Ese? A1DYN", "Status:ESE"),
        ("Read:Position? 1", "Read:Position"),
        ("*stb?", "*STB"),
    ],
)
def test_the_manuals_own_short_forms(text: str, path: str) -> None:
    assert one(text).path == path


@pytest.mark.parametrize(
    "text",
    [
        ":Demand:Posn 3,10.5",
        ":D:P,3,10.5",
        ":Dem",
        ":Demand::Rate 1,0",
        ":",
        "?",
        ":Nonsense 1",
        "#14abcd",
        ":Demand Rate",
    ],
)
def test_the_manuals_own_errors(text: str) -> None:
    (item,) = parse_message(text)
    assert isinstance(item, BadCommand)


def test_semicolon_keeps_level_and_colon_returns_to_root() -> None:
    assert parse_message(":D:R 1,1.1;R 3,45;:Mode:Rate 1;Off 2") == [
        AclRequest("Demand:Rate", query=False, arguments=("1", "1.1")),
        AclRequest("Demand:Rate", query=False, arguments=("3", "45")),
        AclRequest("Mode:Rate", query=False, arguments=("1",)),
        AclRequest("Mode:Off", query=False, arguments=("2",)),
    ]


def test_a_command_of_another_subsystem_needs_the_colon() -> None:
    good, bad = parse_message(":Dem:Pos 1,2;Close 1")
    assert isinstance(good, AclRequest)
    assert isinstance(bad, BadCommand)


def test_a_main_level_query_leaves_the_parser_at_the_root() -> None:
    assert [item.path for item in parse_message(":M? 1;M? 1;Read:Rate? 1") if isinstance(item, AclRequest)] == [
        "Mode",
        "Mode",
        "Read:Rate",
    ]


def test_common_commands_do_not_move_the_level() -> None:
    items = parse_message(":Read:Pos? 1;*STB?;Rate? 1")
    assert [item.path for item in items if isinstance(item, AclRequest)] == ["Read:Position", "*STB", "Read:Rate"]


def test_the_question_mark_may_follow_a_blank() -> None:
    assert one(":Read:Acceleration ?1") == AclRequest("Read:Acceleration", query=True, arguments=("1",))


FULL_PATHS = [":".join(part.split("|")[0] for part in command.split(":")) for command in COMMANDS]


@given(
    path=st.sampled_from(FULL_PATHS),
    colon=st.booleans(),
    lower=st.booleans(),
    query=st.booleans(),
    numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False, width=32), max_size=4),
)
def test_full_words_always_name_their_command(
    path: str, *, colon: bool, lower: bool, query: bool, numbers: list[float]
) -> None:
    text = (":" if colon else "") + (path.lower() if lower else path) + ("?" if query else "")
    arguments = tuple(str(number) for number in numbers)
    assert one(f"{text} {','.join(arguments)}") == AclRequest(path, query=query, arguments=arguments)


@given(st.text(alphabet=string.printable + "°", max_size=60))
def test_any_text_gives_one_item_a_command(text: str) -> None:
    assert len(parse_message(text)) == sum(1 for part in text.split(";") if part.strip())


# INT and INTER are Interlock, so Interface needs its sixth letter
CUTTABLE = [path for path in FULL_PATHS if not path.startswith("Interface")]


@given(path=st.sampled_from(CUTTABLE), cut=st.integers(min_value=3, max_value=12))
def test_abbreviated_mnemonic_stays_in_its_subsystem(path: str, cut: int) -> None:
    main, _, sub = path.partition(":")
    text = main[:cut] + (":" + sub[:cut] if sub else "")
    assert one(text).path.split(":")[0] == main


def test_interface_needs_its_sixth_letter() -> None:
    assert one("Interf:RS232").path == "Interface:RS232"
    (item,) = parse_message("Inter:RS232")
    assert isinstance(item, BadCommand)
