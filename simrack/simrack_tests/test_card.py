"""Conformance cards: what a table has of a list, the cards of all models, the page in the docs."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest
from simrack.card import IEEE_488_2, card, compared, knows, of_manual, overview, page, spellings
from simrack.models import MODELS
from simrack.scpi import COMMON_COMMANDS, Command, CommandTable, Integer
from typer.testing import CliRunner

TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command("OUTPut[:STATe]", (Integer(),), do=lambda *_: None, query=lambda _: 0),
    Command("TRACe:DATA", query=lambda _: 0),
    Command("ABORt", do=lambda _: None),
    Command("CHANnel<1-2>:LABel", query=lambda *_: ""),
)


def test_a_header_stands_for_all_its_spellings() -> None:
    assert set(spellings("A[:B]:{C|D}?")) == {"A:B:C?", "A:B:D?", "A:C?", "A:D?"}


@pytest.mark.parametrize(
    ("header", "known"),
    [
        ("OUTPut[:STATe]", True),
        ("OUTPut[:STATe]?", True),
        ("OUTPut[:LEVel]", False),
        ("TRACe:DATA", True),
        ("TRACe:{DATA|FREE}?", False),
        ("ABORt", True),
        ("ABORt?", False),
        ("CHANnel2:LABel?", True),
        ("CHANnel2:SCALe", False),
        ("*IDN?", True),
        ("*TRG", False),
    ],
)
def test_a_header_is_known_where_the_table_has_every_spelling(header: str, known: bool) -> None:  # noqa: FBT001
    assert knows(TABLE, header) is known


def test_what_is_lacking_of_a_list_is_named() -> None:
    found = compared(TABLE, IEEE_488_2, "IEEE 488.2")
    assert found.unknown == ("*TST?",)
    assert str(found) == "12 of 13"


@pytest.mark.parametrize("name", MODELS)
def test_model_has_ieee_488_2_commands_and_sources(name: str) -> None:
    assert not compared(MODELS[name].load().table, IEEE_488_2, "").unknown
    assert "nverified" in card(name)


@pytest.mark.parametrize("name", ["34401A", "E3631A"])
def test_the_whole_manual_is_known(name: str) -> None:
    assert not of_manual(MODELS[name]).unknown


def test_unknown_manual_lines_are_on_card() -> None:
    manual = of_manual(MODELS["34461A"])
    assert "CALCulate:TRANsform:HISTogram:ALL?" in manual.unknown
    assert all(f"\n{line}\n" in card("34461A") for line in manual.unknown)


@pytest.mark.parametrize("name", MODELS)
def test_drivers_messages_are_known_or_of_other_models(name: str) -> None:
    manual = of_manual(MODELS[name])
    assert not [header for header in manual.unknown if manual.drivers[header]]
    table = MODELS[name].load().table
    assert not [header for header in manual.others if knows(table, header)]


def test_headers_of_other_models_are_on_card_with_reason() -> None:
    said = "\nSAMPle:TIMer (1) # a 34465A or 34470A has it (QCoDeS' driver)\n"
    assert said in card("34461A")
    assert "SAMPle:TIMer" in of_manual(MODELS["34465A"]).known
    assert "SYSTem:LOCal" in of_manual(MODELS["33511B"]).others  # of all models of the list


def test_a_list_that_is_not_the_manuals_says_so() -> None:
    assert "Not the manual's index" in card("2000")


def test_every_list_of_headers_belongs_to_a_model() -> None:
    assert {each.name for each in (files("simrack") / "manuals").iterdir()} == {
        model.index for model in MODELS.values()
    }


def test_page_has_a_card_of_each_model() -> None:
    titles = [name for line in re.findall(r"^## (.+)$", page(), re.MULTILINE) for name in line.split(", ")]
    assert sorted(titles) == sorted(MODELS)


def test_card_command_prints_card_or_table() -> None:
    from simrack.cli import app  # noqa: PLC0415  (imports what serves)

    assert CliRunner().invoke(app, ["card", "34461A"]).stdout == card("34461A") + "\n"
    assert CliRunner().invoke(app, ["card"]).stdout == overview() + "\n"
    refused = CliRunner().invoke(app, ["card", "34402A"])
    assert refused.exit_code == 2
    assert "34401A" in refused.output.replace("\n", "")
