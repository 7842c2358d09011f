"""Conversations of several messages, as the manuals describe them."""

from __future__ import annotations

import pytest
from simrack_tests.cells import few

from tests.conformance import walk
from tests.conformance.walk import Bench, matches


@pytest.mark.parametrize("length", few(["short", "long"], "short"))
@pytest.mark.parametrize("model", [*walk.MODELS, *walk.SUCCESSORS])
def test_exchanges(model: str, length: str) -> None:
    for exchange in walk.load(model)["exchange"]:
        if exchange.get("long", False) is (length == "long"):
            bench = walk.bench(model, exchange.get("interface", "gpib"))
            for number, step in enumerate(exchange["talk"]):
                act(bench, step, f"{exchange['name']} [{exchange['grade']}], step {number}, {step!r}")


def act(bench: Bench, step: str, place: str) -> None:
    verb, _, rest = step.partition(" ")
    if verb == "repeat":
        times, _, repeated = rest.partition(" ")
        for _ in range(int(times)):
            act(bench, repeated, place)
    else:
        _ACTS[verb](bench, rest, place)


def _write(bench: Bench, message: str, _place: str) -> None:
    bench.write(message)


def _bytes(bench: Bench, text: str, _place: str) -> None:
    bench.send(text.encode("latin-1"), end=False)


def _reply(bench: Bench, expected: str, place: str) -> None:
    answer = bench.read()
    assert matches(answer, expected), f"{place}: got {answer!r}"


def _error(bench: Bench, expected: str, place: str) -> None:
    number = bench.error()
    if expected == "nonzero":
        assert number, place
    else:
        assert number in {int(text) for text in expected.split("|")}, f"{place}: got {number}"


def _poll(bench: Bench, expected: str, place: str) -> None:
    status = bench.device.status_byte()
    assert status == int(expected), f"{place}: got {status}"


def _wait(bench: Bench, seconds: str, _place: str) -> None:
    bench.clock.sleep_until(bench.clock.now() + float(seconds))


def _silence(bench: Bench, seconds: str, place: str) -> None:
    answer = bench.read(float(seconds or 0.1))
    assert answer is None, f"{place}: got {answer!r}"


def _soon(bench: Bench, rest: str, place: str) -> None:
    _silence(bench, rest.partition(" ")[0], place)


def _later(bench: Bench, rest: str, place: str) -> None:
    _reply(bench, rest.removeprefix("< "), place)


def _clear(bench: Bench, _rest: str, _place: str) -> None:
    bench.device.clear()


def _trigger(bench: Bench, _rest: str, _place: str) -> None:
    bench.device.trigger()


_ACTS = {
    ">": _write,
    "bytes": _bytes,
    "<": _reply,
    "!": _error,
    "poll": _poll,
    "wait": _wait,
    "silence": _silence,
    "soon": _soon,
    "later": _later,
    "clear": _clear,
    "trigger": _trigger,
}
