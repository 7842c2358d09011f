"""The waveform memory takes what fits into it, however it is written down."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from simrack_tests.cells import few
from simrack_tests.instruments.agilent33220a.bench import Socket

FULL = 65536
CODES = [(7 * place) % 16383 - 8191 for place in range(FULL)]
LINES = {
    "block": b"DATA:DAC VOLATILE, #6131072" + struct.pack(f">{FULL}h", *CODES),
    "codes": b"DATA:DAC VOLATILE, " + b",".join(b"%d" % code for code in CODES),
    "volts": b"DATA VOLATILE, " + b",".join(b"%+.7E" % (code / 8191) for code in CODES),
}


@pytest.mark.parametrize("kind", few(LINES, "block"))
def test_a_waveform_of_full_length_is_taken(kind: str) -> None:
    box = Socket()
    box.send(LINES[kind])
    box.send("FUNC:USER VOLATILE;:FUNC USER;:FREQ 1;:VOLT 2;:OUTP ON")
    assert box.errors() == []
    assert box.ask("DATA:ATTR:POIN?") == "+65536"
    places = [0, 1, 1234, FULL - 1]
    wanted = [2 * CODES[place] / 8191 for place in places]  # open circuit: twice the 1 V of the peak
    assert box.volts([(place + 0.5) / FULL for place in places]) == pytest.approx(wanted, abs=1e-6)


def test_points_are_looked_up_at_the_ticks_of_50_mhz() -> None:
    """User's Guide p. 325: of 65536 points at 1 kHz, 65.5 a microsecond, some are skipped; at 500 Hz none is."""
    box = Socket()
    box.send(LINES["block"])
    box.send("FUNC:USER VOLATILE;:FUNC USER;:FREQ 1000;:VOLT 2;:OUTP ON")
    ticks = 50_000 + np.arange(50_000)
    seen = box.volts((ticks[:, None] + np.array([0.1, 0.5, 0.9])) / 50e6)
    assert np.all(np.ptp(seen, axis=1) == 0.0)
    places = (ticks - 50_000) * FULL // 50_000
    between = (ticks * FULL) % 50_000 > 0  # a tick that falls on a point may show it or the one before
    assert seen[between, 0] == pytest.approx(2 * np.array(CODES)[places[between]] / 8191, abs=1e-6)
    assert len(set(places)) == 50_000
    box.send("FREQ 500")
    shown = box.volts(1.0 + (np.arange(100_000) + 0.5) / 50e6)
    codes = np.round(shown / 2 * 8191).astype(int)
    assert set(codes) == set(CODES)


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
