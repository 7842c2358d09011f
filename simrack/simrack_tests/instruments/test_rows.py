"""Every row of every model's commands with its fewest and its most arguments: an answer or an error, never silence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack.clock import VirtualClock
from simrack.models import RACK
from simrack.plan import plan_of
from simrack.rack import Rack
from simrack.scpi.mnemonics import Mnemonic

from simrack import scpi
from simrack_tests.cells import few
from simrack_tests.instruments.conversation import Conversation

if TYPE_CHECKING:
    from collections.abc import Iterator

ONE_OF_EACH = (
    *("E3631A", "E36312A", "33220A", "33522B", "34401A", "34465A", "2000", "DMM6500", "DSO7104B", "MSOX3104T"),
    "ATS-545",
)
LONGEST_S = 200.0
"""That a measurement takes at most."""
ANOTHER_LANGUAGE = ("L2", "L3")
"""After it the 34401A hears nothing but the way back."""


def some(parameter: scpi.Parameter) -> str:
    """Return something that `parameter` may be, as far as that can be known without the model."""
    match parameter:
        case scpi.Choice():
            return spelled(Mnemonic.parse(parameter.words[0]))
        case scpi.Number(limits=scpi.Limits() as limits):
            return f"{limits.minimum:g}"
        case scpi.Text():
            return '"A"'
        case scpi.Word():
            return "ABC"
        case scpi.Block():
            return "#11A"
    return "1"


def spelled(word: Mnemonic) -> str:
    return word.long + (str(word.suffixes[1]) if word.suffixes else "")


def messages(command: scpi.Command) -> Iterator[str]:
    header = ":".join(spelled(word) for words, _ in command.parts() for word in words)
    forms = [(command.do, "", command.parameters, command.repeat)]
    forms.append((command.query, "?", command.query_parameters or (), command.repeat and command.do is None))
    for handler, mark, parameters, repeats in forms:
        least = [some(each) for each in parameters if each.required]
        most = [some(each) for each in (*parameters, *parameters[-1:] * (2 * repeats))]
        for arguments in {tuple(least), tuple(most)} if handler is not None else ():
            yield f"{header}{mark} {','.join(arguments)}".rstrip()


@pytest.mark.parametrize("model", few([name for name, each in RACK.items() if each.kind != "rate table"], *ONE_OF_EACH))
def test_a_row_is_answered_or_refused(model: str) -> None:
    clock = VirtualClock()
    device = Rack.build(clock, plan_of([model])).devices[model]
    assert isinstance(device, scpi.ScpiTwin)
    talk, silent, sent = Conversation(device, clock), list[str](), 0
    for message in (each for command in device.engine.table.commands for each in messages(command)):
        if message in ANOTHER_LANGUAGE:
            continue
        device.clear()
        talk.write("*RST;*CLS")
        talk.write(message)
        sent += 1
        if "?" in message:
            answer = talk.read(LONGEST_S)
            device.clear()
            silent += [message] if answer is None and not device.engine.errors else []
    assert silent == []
    assert sent > 50
