"""The waveform memory takes what fits into it, however it is written down."""

from __future__ import annotations

import struct

import pytest

from tests.sim.instruments.agilent33220a.bench import Socket

FULL = 65536
CODES = [(7 * place) % 16383 - 8191 for place in range(FULL)]
LINES = {
    "block": b"DATA:DAC VOLATILE, #6131072" + struct.pack(f">{FULL}h", *CODES),
    "codes": b"DATA:DAC VOLATILE, " + b",".join(b"%d" % code for code in CODES),
    "volts": b"DATA VOLATILE, " + b",".join(b"%+.7E" % (code / 8191) for code in CODES),
}


@pytest.mark.parametrize("kind", LINES)
def test_a_waveform_of_full_length_is_taken(kind: str) -> None:
    box = Socket()
    box.send(LINES[kind])
    box.send("FUNC:USER VOLATILE;:FUNC USER;:FREQ 1;:VOLT 2;:OUTP ON")
    assert box.errors() == []
    assert box.ask("DATA:ATTR:POIN?") == "+65536"
    places = [0, 1, 1234, FULL - 1]
    wanted = [2 * CODES[place] / 8191 for place in places]  # open circuit: twice the 1 V of the peak
    assert box.volts([(place + 0.5) / FULL for place in places]) == pytest.approx(wanted, abs=1e-6)


def test_one_point_more_is_too_much_data() -> None:
    box = Socket()
    box.send(b"DATA VOLATILE, " + b"0," * FULL + b"0")
    assert [error.split(",")[0] for error in box.errors()] == ["-223"]
    box.send(b"DATA:DAC VOLATILE, #6131074" + bytes(2 * FULL + 2))
    assert [error.split(",")[0] for error in box.errors()] == ["-223"]


@pytest.mark.parametrize("piece", [1_000_000, 4096])
def test_a_line_of_a_million_characters_is_refused_once(piece: int) -> None:
    box = Socket()
    line = b"FREQ " + b"1" * 1_000_000 + b"\n"
    for start in range(0, len(line), piece):
        box.generator.write(line[start : start + piece], end=False)
    assert [error.split(",")[0] for error in box.errors()] == ["+521"]
    assert box.ask("FREQ?") == "+1.0000000000000E+03"
