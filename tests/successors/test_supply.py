"""The E36312A beside the E3631A: console, data sheet and drawn specimens."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.instruments.e36312a import Errors36312A

from tests.successors import BENCH
from vcfbench.bench.discovery import recognise
from vcfbench.bench.file import parse_bench
from vcfbench.bench.guard.channels import channel_rules
from vcfbench.bench.guard.message import Unreadable
from vcfbench.bench.guard.rules import BeyondLimit
from vcfbench.specifications import KEYSIGHT_E36312A

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription

ANSWERS = {
    "OUTP? (@1,2,3)": "0,1,1",
    "VOLT? (@1,2,3)": "0,10,10",
    "CURR? (@1,2,3)": "5,0.1,0.1",
    "INST:NSEL?": "+2",
}


@pytest.fixture(scope="module")
def described() -> BenchDescription:
    return parse_bench(BENCH.read_text(encoding="utf-8"), "lab.toml")


@pytest.mark.parametrize(
    "message",
    [
        *("VOLT 10.2,(@2,3)", "VOLT 10", "APPL CH3,9.9,0.1", "APPL N25V,10", "OUTP ON,(@2:3)", "VOLT 0,(@1)"),
        *("OUTP OFF,(@1,2,3)", "OUTP 0", "INST CH1;:VOLT 0", "VOLT:PROT 11,(@2)", "OUTP:PAIR OFF", "CURR 0.2,(@2:3)"),
    ],
)
def test_the_console_takes_what_is_within_the_rails(message: str, described: BenchDescription) -> None:
    channel_rules(described).judge(message, ANSWERS.__getitem__)


@pytest.mark.parametrize(
    ("message", "refusal"),
    [
        *(
            ("VOLT 11,(@2)", BeyondLimit),
            ("VOLT 5,(@1)", BeyondLimit),
            ("CURR 0.3,(@2,3)", BeyondLimit),
            ("INST CH1;:VOLT 1", BeyondLimit),
        ),
        *(("VOLT -10,(@3)", BeyondLimit), ("OUTP:PAIR SER", Unreadable), ("VOLT 10,(@4)", Unreadable)),
        *(("OUTP:PROT:CLE", Unreadable), ("*RST", Unreadable), ("VOLT 10,(@)", Unreadable)),
    ],
)
def test_the_console_refuses_what_is_not(message: str, refusal: type[Exception], described: BenchDescription) -> None:
    with pytest.raises(refusal):
        channel_rules(described).judge(message, ANSWERS.__getitem__)


def test_specimens_read_back_within_the_sheet_that_the_uncertainties_use() -> None:
    drawn = [Errors36312A.drawn(np.random.default_rng(seed)) for seed in range(60)]
    for name, (part, volts) in KEYSIGHT_E36312A.voltage.items():
        outputs = [each.of(name) for each in drawn]
        assert 0.2 < np.std([each.readback_gain for each in outputs]) / part < 0.3
        assert 0.2 < np.std([each.readback_offset_v for each in outputs]) / volts < 0.3


def test_discovery_finds_it_by_a_real_reply() -> None:
    assert recognise("Keysight Technologies,E36312A,MY59002391,2.1.0-1.0.4-1.12") == "E36312A"
