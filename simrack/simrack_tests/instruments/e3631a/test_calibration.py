"""Adjusting the simulated E3631A from outside, by what a voltmeter at its terminals says."""

from __future__ import annotations

import pytest
from msgspec.structs import replace
from simrack.instruments.e3631a.imperfections import OutputErrors, SupplyErrors

from simrack_tests.instruments.e3631a.test_instrument import Bench, bench

BAD = OutputErrors(
    programming_gain=2e-3,
    programming_offset_v=30e-3,
    current_programming_gain=-3e-3,
    current_programming_offset_a=5e-3,
    readback_gain=-1e-3,
    readback_offset_v=20e-3,
    current_readback_gain=2e-3,
    current_readback_offset_a=-4e-3,
)
RAIL = {"P25V": "positive", "N25V": "negative"}


def unsecured(output: str) -> Bench:
    on = bench(SupplyErrors(p25v=BAD, n25v=BAD))
    on.talk.write(f"CAL:SEC:STAT OFF,HP003631;:INST {output};:OUTP ON")
    on.talk.settle()
    return on


def adjust_volts(on: Bench, output: str, *, error_v: float = 0.0) -> None:
    for level in ("MIN", "MAX"):
        on.talk.write(f"CAL:VOLT:LEV {level}")
        on.talk.settle()
        on.talk.write(f"CAL:VOLT {on.world.rail_v(RAIL[output]) + error_v:.9f} V")
        on.talk.settle()


@pytest.mark.parametrize(("output", "sign"), [("P25V", 1.0), ("N25V", -1.0)])
def test_an_adjusted_output_gives_and_reads_what_it_is_told(output: str, sign: float) -> None:
    on = unsecured(output)
    on.talk.write(f"VOLT {sign * 12}")
    on.talk.settle()
    assert on.world.rail_v(RAIL[output]) == pytest.approx(sign * (12 * 1.002 + 0.03), abs=1e-9)
    adjust_volts(on, output)
    on.talk.write(f"VOLT {sign * 12}")
    on.talk.settle()
    assert on.talk.errors() == []
    assert on.world.rail_v(RAIL[output]) == pytest.approx(sign * 12.0, abs=1e-7)
    assert float(on.talk.ask("MEAS?") or "") == pytest.approx(sign * 12.0, abs=1e-6)


def test_it_is_as_wrong_as_the_voltmeter_that_was_used() -> None:
    on = unsecured("P25V")
    adjust_volts(on, "P25V", error_v=0.1)
    on.talk.write("VOLT 12")
    on.talk.settle()
    assert on.world.rail_v("positive") == pytest.approx(11.9, abs=1e-6)
    assert float(on.talk.ask("MEAS?") or "") == pytest.approx(12.0, abs=1e-6)


def test_currents_are_adjusted_into_a_short_circuit() -> None:
    on = unsecured("P25V")
    on.world.load_ohm["positive"] = 2.0
    on.talk.write("VOLT 20")
    for level in ("MIN", "MAX"):
        on.talk.write(f"CAL:CURR:LEV {level}")
        on.talk.settle()
        on.talk.write(f"CAL:CURR {on.world.rail_v('positive') / 2.0:.9f}")
    on.talk.write("CURR 0.5")
    on.talk.settle()
    assert on.talk.errors() == []
    assert on.world.rail_v("positive") / 2.0 == pytest.approx(0.5, abs=1e-6)
    assert float(on.talk.ask("MEAS:CURR?") or "") == pytest.approx(0.5, abs=1e-6)


def test_calibration_changes_one_output_and_survives_reset() -> None:
    on = unsecured("P25V")
    before = on.supply.outputs["N25V"].errors
    adjust_volts(on, "P25V")
    after = on.supply.outputs["P25V"].errors
    on.talk.write("*RST")
    on.talk.settle()
    assert on.supply.outputs["N25V"].errors == before
    assert on.supply.outputs["P25V"].errors == after
    assert after == replace(
        BAD,
        programming_gain=after.programming_gain,
        programming_offset_v=after.programming_offset_v,
        readback_gain=after.readback_gain,
        readback_offset_v=after.readback_offset_v,
    )


def test_the_count_goes_up_with_every_point() -> None:
    on = unsecured("P25V")
    assert on.talk.ask("CAL:COUN?") == "1"
    adjust_volts(on, "P25V")
    assert on.talk.ask("CAL:COUN?") == "3"


@pytest.mark.parametrize(
    ("messages", "number"),
    [
        (["CAL:SEC:STAT ON,HP003631", "CAL:VOLT:LEV MIN"], 702),
        (["OUTP OFF", "CAL:VOLT:LEV MIN"], 708),
        (["CAL:VOLT 1"], -221),
        (["CAL:VOLT:LEV MIN", "CAL:CURR 1"], -221),
        (["CAL:VOLT:LEV MIN", "INST N25V", "CAL:VOLT 1.25"], -221),
        (["CAL:VOLT:LEV MIN", "CAL:VOLT 1.25", "CAL:VOLT:LEV MAX", "CAL:VOLT 20"], 712),
        (["CAL:VOLT:LEV MIN", "CAL:VOLT 5", "CAL:VOLT:LEV MAX", "CAL:VOLT 5"], 712),
        (["CAL:SEC:CODE ABCDEFGHIJKLM"], 704),
        (["CAL:SEC:CODE SECRET", "CAL:SEC:STAT ON,HP003631"], 703),
    ],
)
def test_refusals_change_nothing(messages: list[str], number: int) -> None:
    on = unsecured("P25V")
    for message in messages:
        on.talk.write(message)
        on.talk.settle()
    assert on.talk.errors() == [number]
    assert on.supply.outputs["P25V"].errors == BAD
