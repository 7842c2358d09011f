"""What a person types: what is taken, what is asked for again, and what is kept for the record."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from vcfbench.clock import Deadline, WallClock
from vcfbench.drivers.hands import HandMeter, Hands, HandSupply, HandTable
from vcfbench.errors import MeasurementError, PlanError
from vcfbench.interfaces import PowersRails, ReadsVoltage, Regulation, Rotates, lacking
from vcfbench.station.description import OutputMeterRole, PowerRole, RateTableRole

if TYPE_CHECKING:
    from vcfbench.interfaces import Request

SUPPLY = PowerRole(resource="hand://x/power", model="PL330T", by="hand")
METER = OutputMeterRole(resource="hand://x/multimeter", model="34401A", by="hand", resolution_v=1e-3)
TABLE = RateTableRole(resource="hand://x/rate_table", dialect="hand", by="hand", axis_sign=-1)


def typing(*answers: str) -> tuple[Hands, list[str]]:
    """Return hands that type these answers, and the words that they were asked."""
    left, asked, hands = list(answers), list[str](), Hands()

    def operator(request: Request) -> str:
        asked.append(request.words)
        return left.pop(0)

    hands.operator = operator
    return hands, asked


@pytest.mark.parametrize(
    ("kind", "protocol"), [(HandSupply, PowersRails), (HandMeter, ReadsVoltage), (HandTable, Rotates)]
)
def test_each_can_do_what_its_role_is_asked_for(kind: type, protocol: type) -> None:
    assert lacking(kind, protocol) == ()


def test_typed_value_that_cannot_be_is_asked_for_again() -> None:
    hands, asked = typing("done", "nan", "12.5", "-0,04", "\N{MINUS SIGN}0,042")
    assert hands.number("it", "V", 12.0, 3) == -0.042
    assert asked[0] == "type it (V, at most 12, 3 decimals)"
    assert asked[1] == "type it (V, at most 12, 3 decimals), not 'done'"
    assert [answer for _, answer in hands.taken()] == ["done", "nan", "12.5", "-0,04", "\N{MINUS SIGN}0,042"]
    assert hands.taken() == []


def test_after_five_tries_it_is_given_up() -> None:
    with pytest.raises(MeasurementError, match="after 5 tries got 'x'"):
        typing(*"xxxxx")[0].number("it", "V", 1.0)
    with pytest.raises(MeasurementError, match="expected the same entry twice"):
        typing(*"1234567890")[0].twice("it", "V", 10.0)
    with pytest.raises(PlanError, match="a person has to type it"):
        Hands().number("it", "V", 1.0)


def test_a_read_back_is_typed_twice_where_it_has_changed() -> None:
    hands, asked = typing("0", "10", "1.0", "10", "10.0", "10", "0", "0")
    table = HandTable("rate_table", TABLE, hands, {"max_rate_deg_s": 50.0})
    assert [table.rate_deg_s() for _ in range(4)] == [0.0, -10.0, -10.0, 0.0]
    assert asked[4] == "type the rate that the table shows again (deg/s, at most 100)"
    assert len(asked) == 8
    assert table.command_safe().last_read == "0 deg/s"


def test_moved_reading_is_typed_again() -> None:
    hands, asked = typing("", "0.100", "0.101", "0.500", "0.400", "0.403", *(f"{v}.000" for v in range(1, 6)))
    meter = HandMeter("multimeter", METER, hands, {})
    meter.configure_dc_voltage(10.0, 10.0)
    assert [meter.read_voltage_v() for _ in range(3)] == [0.1, 0.101, 0.403]
    again = "type the multimeter's reading again, as it shows now, for it has moved (V, at most 12, 3 decimals)"
    assert asked[4:6] == [again] * 2
    with pytest.raises(MeasurementError, match=r"no two in a row were within 0\.01 V"):
        meter.read_voltage_v()


def test_a_supply_is_off_when_that_was_typed() -> None:
    hands, _ = typing("", "10.01", "10.01", "cc", "no", "off")
    supply = HandSupply("power", SUPPLY, hands, {})
    supply.enable_outputs()
    assert supply.measure_voltage_v("P25V") == 10.01
    assert supply.regulation("P25V") is Regulation.CONSTANT_CURRENT
    assert supply.outputs_enabled()
    report = supply.make_safe(Deadline.after(WallClock(), 1.0))
    assert (report.safe, report.detail) == (True, "off, as typed by the operator")
    assert not supply.outputs_enabled()


def test_a_table_that_turns_is_not_safe() -> None:
    hands, asked = typing(*["5"] * 5)
    table = HandTable("rate_table", TABLE, hands, {"max_rate_deg_s": 50.0})
    report = table.make_safe(Deadline.after(WallClock(), 1.0))
    assert not report.safe
    assert "expected the table at rest, the operator typed 5 deg/s" in report.detail
    assert len(asked) == 5
