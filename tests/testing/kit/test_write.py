"""What the kit asks is made of the rows that say that they only read."""

from __future__ import annotations

import pytest
from simrack.models import MODELS

from tests.cells import few
from vcfbench.clock import Deadline
from vcfbench.testing.kit.write import TwinWire, answers, questions, scripts, twin

MEASURES = ("READ?", "FETC?", "MEAS:VOLT?", "*TST?", "*ESR?", "SYST:ERR?", "CAL?", "STAT:QUES?", "TRAC:DATA?", "*LRN?")


def test_nothing_that_measures_clears_or_acts_is_among_them() -> None:
    asked = {question for script in scripts().values() for question in script["reads"]}
    assert asked & set(MEASURES) == set()
    assert {"*IDN?", "VOLT:RANG?", "OUTP?", "CHAN1:SCAL?", "SOUR2:FREQ?", "STAT:QUES:COND?"} <= asked
    assert sum(len(script["reads"]) for script in scripts().values()) > 2900


@pytest.mark.parametrize("model", few(list(MODELS), "34401A"))
def test_asking_changes_no_answer(model: str) -> None:
    asked = questions(MODELS[model].load().table)
    assert list(answers(model, asked + asked[1:])) == [*answers(model, asked)] * 2


@pytest.mark.parametrize("model", few(list(MODELS), "E3631A"))
def test_kit_sets_small_levels_and_switches_off(model: str) -> None:
    script, (device, clock) = scripts()[model], twin(model)
    wire = TwinWire(device, clock)
    for message in [each for each, _, _ in script["drives"]] + script["safe"]:
        wire.send(message.encode() + b"\n", Deadline.after(clock, 5.0))
        while "?" in message and not wire.receive(Deadline.after(clock, 5.0))[1]:
            pass
    on = [output for output in ("OUTP", "OUTP1", "OUTP2", "OUTP (@1,2,3)") if _is_on(wire, clock, output)]
    assert on == []


def _is_on(wire: TwinWire, clock: object, output: str) -> bool:
    header, _, channels = output.partition(" ")
    question = f"{header}? {channels}".strip()
    wire.clear(Deadline.after(clock, 1.0))  # type: ignore[arg-type]
    wire.send(question.encode() + b"\n", Deadline.after(clock, 1.0))  # type: ignore[arg-type]
    try:
        return b"1" in wire.receive(Deadline.after(clock, 1.0))[0]  # type: ignore[arg-type]
    except Exception:  # noqa: BLE001  # it has no such output
        return False
