"""What the kit records of a simulated instrument is what that says, and each planted difference is found."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

import pytest
from simrack.models import MODELS

from tests.cells import few
from tests.testing.kit.recording import left_anyhow, recorded
from vcfbench.testing.kit.check import Status, checked

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", few(list(MODELS), "34401A", "E3631A"))
def test_a_simulated_instrument_is_the_same_as_itself(tmp_path: Path, model: str) -> None:
    left_anyhow(model, Random(model))  # noqa: S311
    assert recorded(tmp_path / "a.trace", model) == 0
    (seen,) = checked(tmp_path / "a.trace")
    assert (seen.model.removeprefix("MODEL "), seen.driven) == (model, True)
    assert list(map(str, seen.differing)) == []
    assert seen.count("unknown") == 0 < seen.count("same")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    path = tmp_path_factory.mktemp("kit") / "both.trace"
    recorded(path, "34401A", "33220A")
    return path.read_text("ascii").splitlines()


SLOW, SILENT = "slow", "silent"
PLANTED: list[tuple[str, str, str, Status]] = [
    # role, question, what came instead of what the simulated one says, what is found
    ("34401A", "VOLT:RANG?", "10", "form"),
    ("34401A", "VOLT:NPLC?", "+1.000000E+01", "form"),
    ("34401A", "CURR:RANG?", "1.00000000E+00", "form"),
    ("34401A", "RES:RANG?", "+1.00000000E+003", "form"),
    ("34401A", "FUNC?", "VOLT", "form"),
    ("34401A", "CONF?", '"VOLT",10', "form"),
    ("34401A", "TRIG:SOUR?", "XXXXXX", "answer"),
    ("34401A", "INP:IMP:AUTO?", "OFF", "form"),
    ("34401A", "SAMP:COUN?", "1", "form"),
    ("34401A", "TRIG:DEL:AUTO?", "1,1,0.5", "form"),
    ("34401A", "ROUT:TERM?", "XXX", "answer"),
    ("34401A", "CALC:FUNC?", SILENT, "no answer"),
    ("34401A", "CALC:STAT?", '-113,"Undefined header"', "error"),
    ("34401A", "CAL:COUN?", "12.5", "form"),
    ("34401A", "SYST:VERS?", '"1991.0"', "form"),
    ("34401A driven", "VOLT:DC:NPLC?", "+2.00000000E+00", "answer"),
    ("34401A driven", "VOLT:DC:RANG?", "+1.00000000E+02", "answer"),
    ("34401A driven", "TRIG:SOUR IMM", '-221,"Settings conflict"', "error"),
    ("34401A driven", "FETC?", SLOW, "timing"),
    ("33220A", "FREQ?", "1000", "form"),
    ("33220A", "FUNC?", "XXXX", "answer"),
    ("33220A", "OUTP?", "OFF", "form"),
    ("33220A", "VOLT:UNIT?", "XXXX", "answer"),
    ("33220A", "BURS:MODE?", "XXXX", "answer"),
    ("33220A", "OUTP:LOAD?", "50", "form"),
    ("33220A", "OUTP:POL?", SILENT, "no answer"),
    ("33220A", "BURS:NCYC?", "1", "form"),
    ("33220A", "FUNC:PULS:WIDT?", "0.0001", "form"),
    ("33220A", "SWE:TIME?", '-221,"Settings conflict"', "error"),
    ("33220A", "FM:STAT?", "0.0", "form"),
    ("33220A driven", "OUTP ON", '-221,"Settings conflict"', "error"),
]


def planted(lines: list[str], role: str, question: str, came: str) -> list[str]:
    """Return a bundle in which another answer came to the first such question."""
    fields = [line.split("\t") for line in lines]
    at = next(i for i, each in enumerate(fields) if each[1:2] == [role] and each[4] == f"{question}\\n")
    if came.startswith("-"):  # an error, which is told when it is asked for
        at = next(i for i in range(at, len(fields)) if fields[i][4] == "SYST:ERR?\\n")
    changed = [list(each) for each in fields]
    if came == SILENT:
        changed[at + 1][3:] = ["!", "DeadlineExceeded no answer"]
    elif came == SLOW:
        for each in changed[at + 1 :]:
            each[0] = f"{float(each[0]) + 6.0:.6f}"
    else:
        changed[at + 1][4] = f"{came}\\n"
    return ["\t".join(each) for each in changed]


def test_planted_differences_are_found_and_nothing_else(bundle: list[str], tmp_path: Path) -> None:
    lines = bundle
    for role, question, came, _ in PLANTED:
        lines = planted(lines, role, question, came)
    path = tmp_path / "planted.trace"
    path.write_text("\n".join(lines) + "\n", "ascii")
    found = [(each.command, each.status) for seen in checked(path) for each in seen.differing]
    wanted = [(question, status) for _, question, _, status in PLANTED]
    assert len(wanted) >= 30
    assert sorted(found) == sorted(wanted)
