"""Every row of every model's commands with its fewest and its most arguments: a handler that takes them."""

from __future__ import annotations

import inspect

import pytest

from tests.conformance import walk


@pytest.mark.parametrize("model", [*walk.MODELS, *walk.SUCCESSORS])
def test_each_row_takes_its_fewest_and_its_most_arguments(model: str) -> None:
    """What its handler cannot be called with would be silence, as `SYST:TIME?` of the DMM6500 was."""
    wrong = []
    for command in walk.bench(model).device.engine.table.commands:  # type: ignore[attr-defined]
        suffixes = sum(
            word.suffixes is not None and word.suffixes[0] < word.suffixes[1]
            for words, _ in command.parts()
            for word in words
        )
        forms = [(command.do, command.parameters, command.repeat)]
        forms.append((command.query, command.query_parameters or (), command.repeat and command.do is None))
        for handler, parameters, repeats in forms:
            least = sum(each.required for each in parameters) if repeats else len(parameters)
            for count in {least, len(parameters) + 2 * repeats} if handler is not None else ():
                try:
                    inspect.signature(handler).bind(None, *[None] * (suffixes + count))  # type: ignore[arg-type]
                except TypeError as error:
                    wrong.append(f"{command.pattern} with {count}: {error}")
                except ValueError:  # a builtin has no signature
                    continue
    assert wrong == []


@pytest.mark.parametrize(
    ("model", "question", "begins"),
    [
        ("dmm6500", "SYST:TIME?", ""),
        ("dmm6500", "SYST:TIME? 1", ""),
        ("dmm6500", ":SENS:VOLT:INPutimpedance?", "MOHM10"),
        ("dsox3024a", ":DISP:DATA? PNG, COLor", "#8"),
        ("dsox3024a", ":DISP:DATA? COLor", "#8"),
        ("dsox3024a", ":DISP:DATA? PNG, SCReen, COLor", "#8"),
        ("dsox3024a", ":DISP:DATA?", "#8"),
        ("dso7104b", ":DISP:DATA? BMP, GRATicule", "#8"),
        ("keysight33622a", "SOUR1:BPSK:STAT?", "0"),
        ("keysight33622a", "BPSK:STAT?", "0"),
    ],
)
def test_the_forms_of_manuals_are_answered(model: str, question: str, begins: str) -> None:
    bench = walk.bench(model)
    bench.write(question)
    answer = bench.read()
    assert answer is not None
    assert answer.startswith(begins)
    assert bench.error() == 0


def test_a_word_that_no_command_has_is_too_long_beyond_twelve_letters() -> None:
    bench = walk.bench("dmm6500")
    for header, number in ((":SENS:VOLT:INPUTIMPEDANC 1", -112), (":SENS:VOLT:NONSENSE 1", -113)):
        bench.write(header)
        assert bench.error() == number
