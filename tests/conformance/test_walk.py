"""Every command of every instrument: every spelling, bound and refusal that its expectation file names."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few

from tests.conformance import walk
from tests.conformance.walk import Bench, Command, matches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

EVERY = (*walk.MODELS, *walk.SUCCESSORS)
FEW = ("e3631a", "hp34401a", "keysight33622a", "dmm6500")
HP_ERA = {"e3631a", "hp34401a"}
"""The pair whose manuals were read whole: what they say of every parameter is held to the number."""


@cache
def instrument(model: str) -> Bench:
    return walk.bench(model)


def cases(
    wanted: Callable[[Command], Any], kept: tuple[str, ...] = EVERY
) -> Callable[[Callable[[str, Command], None]], Callable[[str], None]]:
    """Make a check of one entry a test of a model: it walks all entries that are `wanted` and names what is wrong.

    Models that are not `kept` are exhaustive.
    """

    def walked(check: Callable[[str, Command], None]) -> Callable[[str], None]:
        found = {model: [case for case in walk.commands(model) if wanted(case[1])] for model in EVERY}

        models = [model for model, entries in found.items() if entries]

        @pytest.mark.parametrize("model", few(models, *(model for model in models if model in kept)))
        def test(model: str) -> None:
            tell(wrong(name, check, model, command) for name, command in found[model])

        return test

    return walked


def wrong(name: str, check: Callable[..., None], *arguments: Any) -> str | None:
    """Return what is wrong with one case, None if nothing is."""
    try:
        check(*arguments)
    except Exception as error:  # noqa: BLE001 - the other cases are looked at all the same
        return f"{name}: {type(error).__name__}: {error}"
    return None


def tell(cases: Iterable[str | None]) -> None:
    """Fail with everything that is wrong, one case a line."""
    mistakes = [case for case in cases if case is not None]
    assert not mistakes, "\n".join(mistakes)


def begun(model: str, command: Command) -> Bench:
    bench = walk.bench(model) if command.fresh else instrument(model)
    bench.device.clear()
    bench.begin(command.arrange)
    return bench


def written(command: Command, argument: str) -> str:
    return f"{command.plain} {argument}".rstrip()


def readback(command: Command) -> str | None:
    return command.readback or command.question


def first_message(command: Command, spelling: str) -> tuple[str, bool]:
    """Return a message that this spelling of the header should take, and whether it answers."""
    if command.reset is not None or command.reply is not None:
        return f"{spelling}?", True
    if command.asks:
        return f"{spelling}? {command.asks[0][0]}", True
    argument = command.accepts[0][0] if command.accepts else command.does[0]
    return f"{spelling} {argument}".rstrip(), False


def all_spellings(command: Command) -> list[str]:
    if command.only_spellings:
        return command.only_spellings
    return [walk.cased(spelling, number) for number, spelling in enumerate(walk.spellings(command.header))]


@cases(lambda command: command.reset is not None or command.reply is not None)
def test_reset_state_is_the_manuals(model: str, command: Command) -> None:
    bench = begun(model, command)
    expected = command.reply if command.reset is None else command.reset
    answer = bench.ask(command.question or "")
    assert matches(answer, str(expected)), f"{command.question} answered {answer!r}, not {expected}"
    assert bench.error() == 0


def _usable(command: Command) -> bool:
    return bool(
        command.reset is not None or command.reply is not None or command.asks or command.accepts or command.does
    )


@cases(_usable, FEW)
def test_every_spelling_is_taken(model: str, command: Command) -> None:
    expected = command.reply if command.reset is None or command.query else command.reset
    for spelling in all_spellings(command):
        for spelled in (spelling, f":{spelling}") if not spelling.startswith("*") else (spelling,):
            bench = begun(model, command)
            message, answers = first_message(command, spelled)
            bench.write(message)
            answer = bench.read() if answers else None
            assert (answer is not None) is answers, message
            if answers and expected is not None:
                assert matches(answer, expected), f"{message} answered {answer!r}"
            assert bench.error() == 0, message


@cases(lambda command: _usable(command) and not command.only_spellings, FEW)
def test_no_other_spelling_is_taken(model: str, command: Command) -> None:
    for spelling in walk.misspellings(command.header):
        if spelling in command.collides:
            continue
        bench = begun(model, command)
        message, _ = first_message(command, spelling)
        bench.write(message)
        number = bench.error()
        too_long = any(len(node.rstrip("0123456789")) > 12 for node in spelling.split(":"))
        assert number == (-112 if too_long else -113), f"{message}: {number}"
        assert bench.error() == 0, message


@cases(lambda command: command.accepts)
def test_arguments_are_taken(model: str, command: Command) -> None:
    for argument, expected in command.accepts:
        bench = begun(model, command)
        message = written(command, argument)
        bench.write(message)
        assert bench.error() == 0, message
        answer = bench.ask(readback(command) or "")
        assert matches(answer, expected), f"{message}, then {readback(command)} answered {answer!r}, not {expected}"
        assert bench.error() == 0, message


@cases(lambda command: command.does)
def test_actions_are_taken(model: str, command: Command) -> None:
    for argument in command.does:
        bench = begun(model, command)
        message = written(command, argument)
        bench.write(message)
        assert bench.error() == 0, message


@cases(lambda command: command.asks)
def test_queries_with_an_argument_are_answered(model: str, command: Command) -> None:
    for argument, expected in command.asks:
        bench = begun(model, command)
        message = f"{command.plain}? {argument}"
        answer = bench.ask(message)
        assert matches(answer, expected), f"{message} answered {answer!r}, not {expected}"
        assert bench.error() == 0, message


def refusals(model: str, command: Command) -> list[tuple[str, tuple[int, ...]]]:
    named = [(argument, (number,)) for argument, number in command.refuses]
    given = {argument for argument, _ in named} | {argument for argument, _ in command.accepts}
    following = walk.refusals_of_kind(command, hp=model in HP_ERA) if command.accepts else []
    return named + [case for case in following if case[0] not in given]


@cases(lambda command: command.refuses or (command.kind and command.accepts))
def test_arguments_are_refused_and_change_nothing(model: str, command: Command) -> None:
    for argument, numbers in refusals(model, command):
        bench = begun(model, command)
        query = readback(command)
        before = bench.ask(query) if query else None
        message = written(command, argument)
        bench.write(message)
        number = bench.error()
        assert number in numbers, f"{message}: {number}, not {numbers}"
        assert bench.error() == 0, message
        assert (bench.ask(query) if query else None) == before, message


@cases(lambda command: command.clips)
def test_arguments_are_clipped_and_reported(model: str, command: Command) -> None:
    for argument, expected, number in command.clips:
        bench = begun(model, command)
        message = written(command, argument)
        bench.write(message)
        assert bench.error() == number, message
        answer = bench.ask(readback(command) or "")
        assert matches(answer, expected), f"{message}, then {answer!r}, not {expected}"


@cases(lambda command: command.ask_refuses)
def test_queries_are_refused(model: str, command: Command) -> None:
    for argument, number in command.ask_refuses:
        bench = begun(model, command)
        message = f"{command.plain}? {argument}".rstrip()
        bench.write(message)
        seen = bench.error()
        assert seen == number, f"{message}: {seen}, not {number}"


@pytest.mark.parametrize("model", [model for model in EVERY if walk.load(model)["absent"]])
def test_what_a_model_has_not_is_refused(model: str) -> None:
    tell(
        wrong(f"{message} [{entry['grade']}]", refused, model, message, entry["number"])
        for entry in walk.load(model)["absent"]
        for message in entry["messages"]
    )


def refused(model: str, message: str, numbers: list[int]) -> None:
    bench = begun(model, Command("", ""))
    bench.write(message)
    number = bench.error()
    assert number in numbers, f"{number}, not {numbers}"
    assert bench.error() == 0


@pytest.mark.parametrize("model", EVERY)
def test_power_on_state_is_the_reset_state(model: str) -> None:
    bench = walk.bench(model)
    for name, command in walk.commands(model):
        if command.reset is not None and not command.arrange:
            answer = bench.ask(command.question or "")
            assert matches(answer, command.reset), f"{name}: {answer!r}"
    assert bench.error() == 0


@pytest.mark.parametrize(
    ("model", "under_way"),
    few(
        [
            ("agilent33220a", "SWE:STAT ON"),
            ("dso7104b", ":RUN"),
            ("e3631a", "OUTP ON"),
            *((meter, state) for meter in ("hp34401a", "keysight34461a") for state in ("*CLS", "SAMP:COUN 3;:INIT")),
        ],
        every=3,
    ),
)
def test_question_that_is_answered_at_once_begins_nothing(model: str, under_way: str) -> None:
    """So a server need not look for what comes next after one."""
    bench, answered = instrument(model), 0
    engine = bench.device.engine  # type: ignore[attr-defined]
    for name, command in walk.commands(model):
        begun(model, command)
        bench.write(under_way)
        for question in {command.question, *(f"{command.plain}? {asked}" for asked, _ in command.asks)} - {None}:
            bench.ask(str(question))
            before = engine.wake_at()
            if engine.answer(f"{question}\n".encode()):
                answered += 1
                assert engine.wake_at() == before, name
    assert answered > 20
