"""Forms of commands that manuals and programs have, and the models had not."""

from __future__ import annotations

import pytest

from tests.conformance import walk


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


def test_unknown_word_beyond_twelve_letters_is_too_long() -> None:
    bench = walk.bench("dmm6500")
    for header, number in ((":SENS:VOLT:INPUTIMPEDANC 1", -112), (":SENS:VOLT:NONSENSE 1", -113)):
        bench.write(header)
        assert bench.error() == number
