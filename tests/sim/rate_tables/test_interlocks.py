"""What shuts a simulated table down by itself: what it does to the motion, and what each language says of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace
from simrack.faults import Fault
from simrack.faulty_device import FaultInjector
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.acl import AclTable
from simrack.rate_tables.atl import AtlTable
from simrack.rate_tables.axis import INTERLOCKS, ServoAxis, TableErrors
from simrack.rate_tables.dd16 import Dd16Table
from simrack.rate_tables.esp import EspTable
from simrack.rate_tables.mn_as import MnAsTable
from simrack.rate_tables.ruya import RuyaTable
from simrack.rate_tables.zaber import StepperErrors, ZaberTable
from simrack.serve.adjust import adjustments_of
from simrack_tests.rate_tables.ideal import exchange
from simrack_tests.rate_tables.turning import RATE, START, aaaa, dd16, mn

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable

TWINS: dict[str, Callable[..., Any]] = {
    "acl": AclTable,
    "zaber": ZaberTable,
    "atl": AtlTable,
    "esp": EspTable,
    "dd16": Dd16Table,
    "mn_as": MnAsTable,
    "ruya": RuyaTable,
    "aaaa": AaaaTable,
}


class Bench:
    def __init__(self, name: str, **errors: Any) -> None:
        self.name = name
        self.clock = VirtualClock()
        mechanics = replace(ideal_bench().table, friction_deg_s2=40.0)
        self.world = World(self.clock, replace(ideal_bench(), table=mechanics), 0)
        kind = StepperErrors if name == "zaber" else TableErrors
        self.table = TWINS[name](self.world, replace(kind.none(), **errors))

    def wait(self, seconds: float) -> None:
        until = self.clock.now() + seconds
        while (wake := self.table.wake_at()) is not None and wake < until:
            self.clock.sleep_until(wake)
            self.table.read(4096)
        self.clock.sleep_until(until)
        self.table.wake_at()

    def start(self) -> None:
        for message in START[self.name]:
            self.table.write(message)
            self.wait(0.6)
        self.wait(2.0)

    def ask(self, message: bytes) -> bytes:
        self.table.clear()
        return exchange(self.table, self.clock, message).strip()

    @property
    def rate_deg_s(self) -> float:
        return self.world.table.rate_deg_s()


@pytest.mark.parametrize("cause", INTERLOCKS)
@pytest.mark.parametrize("name", TWINS)
def test_broken_interlock_bars_the_drive(name: str, cause: str) -> None:
    bench = Bench(name)
    bench.start()
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)
    bench.table.set_interlock(cause, faulty=True)
    assert not bench.world.table.servo_closed
    bench.wait(1.0)
    assert bench.rate_deg_s == pytest.approx(RATE - 40.0, abs=2.5)  # it coasts: dry friction, and a little viscous
    bench.wait(1.0)
    assert bench.rate_deg_s == 0.0
    bench.start()
    assert bench.rate_deg_s == 0.0
    bench.table.set_interlock(cause, faulty=False)
    if name == "acl":
        bench.table.write(b":INT:RESET\n")
    bench.wait(0.2)
    bench.start()
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)


@pytest.mark.parametrize("name", TWINS)
def test_a_table_without_interlocks_turns_on(name: str) -> None:
    bench = Bench(name, interlocks=False)
    bench.start()
    for cause in INTERLOCKS:
        bench.table.set_interlock(cause, faulty=True)
    bench.wait(1.0)
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)


@pytest.mark.parametrize("name", [name for name in TWINS if name != "acl"])
def test_the_measured_rate_trips_whoever_turns_the_axis(name: str) -> None:
    bench = Bench(name, over_rate_trip_deg_s=120.0)
    bench.start()
    bench.world.table.demand_rate(200.0, 100.0)
    bench.wait(0.6)
    assert bench.world.table.servo_closed
    bench.wait(0.5)
    assert not bench.world.table.servo_closed
    assert 80.0 < bench.rate_deg_s < 125.0
    assert [each.read() for each in bench.table.adjustments() if each.name == "shut_down_by"] == [["over_rate"]]


def first_beyond_s(trip_deg_s: float, goal_deg_s: float) -> float:
    """Return how long a table whose rate nobody watches takes to be faster than that, turned by hand from RATE."""
    bench = Bench("atl", over_rate_trip_deg_s=0.0)
    bench.start()
    adjustments_of(bench.world, {})["applied_rate_deg_s"].write(goal_deg_s)
    begun_s = bench.clock.now()
    while abs(bench.rate_deg_s) <= trip_deg_s:
        bench.clock.sleep_until(bench.clock.now() + 1e-4)
    return bench.clock.now() - begun_s


@pytest.mark.parametrize("goal_deg_s", [200.0, -122.0])
@pytest.mark.parametrize("name", TWINS)
def test_table_turned_by_hand_trips_unasked(name: str, goal_deg_s: float) -> None:
    """Within the 2 ms at which a controller looks at its rate."""
    bench = Bench(name, **{} if name == "acl" else {"over_rate_trip_deg_s": 120.0})
    bench.start()
    if name == "acl":
        bench.table.write(b":Limit:Vtrip R,1,120\n")
    adjustments_of(bench.world, {})["applied_rate_deg_s"].write(goal_deg_s)
    expected_s = bench.clock.now() + first_beyond_s(120.0, goal_deg_s)
    while bench.world.table.servo_closed and bench.world.table.goal_deg_s() == goal_deg_s:
        wake_s = bench.table.wake_at()
        assert wake_s is not None
        bench.clock.sleep_until(wake_s)
        assert bench.clock.now() < expected_s + 1.0
        bench.table.read(4096)
    assert expected_s - 1e-3 < bench.clock.now() < expected_s + 2.5e-3
    assert "over_rate" in next(each.read() for each in bench.table.adjustments() if each.name == "shut_down_by")


@pytest.mark.parametrize("name", TWINS)
def test_an_axis_that_is_held_stops_and_trips(name: str) -> None:
    bench = Bench(name)
    bench.start()
    bench.table.jam(held=True)
    bench.wait(0.3)
    assert bench.rate_deg_s == pytest.approx(0.0, abs=1e-6)
    # a stepping motor has no feedback: it stands, with its current on
    assert bench.world.table.servo_closed is (name == "zaber")
    bench.table.jam(held=False)
    if name == "acl":
        bench.table.write(b":INT:RESET\n")
    bench.start()
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)


def test_an_unknown_interlock_is_refused() -> None:
    for name in ("acl", "esp"):
        with pytest.raises(ValueError, match=r"one of .*door"):
            Bench(name).table.set_interlock("window", faulty=True)


@pytest.mark.parametrize(
    ("name", "question", "healthy", "ill"),
    [
        ("acl", b":INT? 1\n", b"Close", b"Fault"),
        ("acl", b":STAT:CSR? A1INTLK,7\n", b"0", b"1"),
        ("zaber", b"/1 1 01\n", b"@01 1 01 OK BUSY -- 0", b"@01 1 01 OK IDLE FH 0"),
        ("zaber", b"/1 1 warnings\n", b"@01 1 OK BUSY -- 00", b"@01 1 OK IDLE FH 02 FH FO"),
        ("zaber", b"/1 1 move vel 1000\n", b"@01 1 OK BUSY NI 0", b"@01 1 RJ IDLE FH DRIVERDISABLED"),
        ("zaber", b"/1 1 driver enable\n", b"@01 1 OK BUSY -- 0", b"@01 1 RJ IDLE FH DRIVERDISABLED"),
        ("atl", b"JOG1\r", b">", b"?\r\n>"),
        ("atl", b"SRV1\r", b">", b"?\r\n>"),
        ("esp", b"TE?\r", b"0", b"129"),
        ("esp", b"1MO?\r", b"1", b"0"),
        ("mn_as", mn("MNENB,1"), mn("ASENB,OK").strip(), b""),
    ],
)
def test_what_each_language_says_of_an_open_door(name: str, question: bytes, healthy: bytes, ill: bytes) -> None:
    bench = Bench(name)
    bench.start()
    assert bench.ask(question) == healthy
    bench.table.set_interlock("door", faulty=True)
    bench.wait(5.0)
    assert bench.ask(question) == ill


@pytest.mark.parametrize(
    ("cause", "number"),
    [("drive_fault", 102), ("emergency_stop", 4), ("interlock", 129), ("over_rate", 110), ("jam", 103)],
)
def test_an_esp_names_what_shut_it_down(cause: str, number: int) -> None:
    bench = Bench("esp", over_rate_trip_deg_s=100.0)
    bench.start()
    if cause == "over_rate":
        bench.world.table.demand_rate(200.0, 500.0)
    elif cause == "jam":
        bench.table.jam(held=True)
    else:
        bench.table.set_interlock(cause, faulty=True)
    bench.wait(2.0)
    assert int(bench.ask(b"TB?\r").split(b",")[0]) == number


def test_zaber_drive_fault_has_own_flag() -> None:
    bench = Bench("zaber")
    bench.table.set_interlock("drive_fault", faulty=True)
    assert bench.ask(b"/1 1\n") == b"@01 1 OK IDLE FV 0"


def status_of(bench: Bench) -> bytes:
    bench.table.clear()
    bench.wait(0.0)
    bench.clock.sleep_until(bench.table.wake_at() or 0.0)
    bench.wait(0.0)
    while True:
        data, _ = bench.table.read(64)
        if data:
            return bytes(data)
        bench.clock.sleep_until(bench.table.wake_at())


def test_alarm_digit_and_alarm_bit() -> None:
    for name in ("ruya", "aaaa"):
        bench = Bench(name)
        bench.start()
        for cause, alarmed in (("door", True), ("", False)):
            bench.table.set_interlock(cause or "door", faulty=alarmed)
            if not alarmed:
                bench.start()
            status = status_of(bench)
            alarm = status[2] - ord("0") if name == "ruya" else status[5] >> 7
            closed = status[3] != ord("0") if name == "ruya" else bool(status[5] & 1)
            assert (bool(alarm), closed) == (alarmed, not alarmed)


def test_dd16_table_only_stands_still() -> None:
    bench = Bench("dd16")
    bench.start()
    assert bench.ask(dd16(1, 0x16))[3] == 2
    bench.table.set_interlock("emergency_stop", faulty=True)
    bench.wait(5.0)
    assert bench.ask(dd16(1, 0x16))[3] == 4


# --- stepping motors --------------------------------------------------------------------------------------------------


def test_a_stepping_motor_stalls_beyond_its_pull_out_rate() -> None:
    bench = Bench("zaber", pull_out_deg_s=80.0)
    bench.start()
    reply = bench.ask(b"/1 1 move vel 291271\n")  # 100 deg/s
    assert b" OK " in reply
    bench.wait(2.0)
    assert bench.rate_deg_s == pytest.approx(0.0, abs=1e-6)
    assert bench.ask(b"/1 1\n") == b"@01 1 OK IDLE FS 0"
    assert bench.ask(b"/1 1 warnings clear\n") == b"@01 1 OK IDLE -- 02 FS NI"
    bench.start()
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)


@pytest.mark.parametrize("arcsec", [0.0, 0.2])
def test_the_steps_of_the_motor_are_in_the_true_rate(arcsec: float) -> None:
    """10 000 full steps a turn: 0.2 arcsec of error are 0.97 % of the rate."""
    bench = Bench("zaber", step_error_arcsec=arcsec)
    bench.start()
    rates = []
    for _ in range(2000):
        bench.clock.sleep_until(bench.clock.now() + 1e-5)
        rates.append(bench.rate_deg_s)
    assert max(rates) - min(rates) == pytest.approx(2 * RATE * 9.696e-3 * arcsec / 0.2, rel=1e-2, abs=1e-4)


# --- ends of travel ---------------------------------------------------------------------------------------------------


def test_limited_travel_stops_at_end_and_turns_back() -> None:
    bench = Bench("aaaa")
    bench.start()
    bench.world.table.demand_rate(100.0, 100.0)  # by another hand, past the end
    bench.wait(12.0)
    assert bench.rate_deg_s == pytest.approx(0.0, abs=1e-6)
    assert 839.3 < bench.world.table.angle_deg() < 839.4 + 60.0  # 100 deg/s at 100 deg/s2 take 50 deg
    assert status_of(bench)[5] >> 7
    bench.table.write(aaaa(0x81, 0, 5000))
    bench.wait(2.0)
    assert bench.rate_deg_s == pytest.approx(-50.0, rel=1e-3)


def test_an_axis_without_ends_turns_on_for_ever() -> None:
    clock = VirtualClock()
    world = World(clock, ideal_bench(), 0)
    axis = ServoAxis(world, TableErrors.none(), 100.0)
    axis.enable()
    axis.run(300.0)
    clock.sleep_until(3600.0)
    axis.advance()
    assert world.table.rate_deg_s() == pytest.approx(300.0)
    assert axis.own_events_s() == ()


def test_what_can_be_thrown_and_seen_from_outside_the_wire() -> None:
    bench = Bench("mn_as")
    offered = adjustments_of(bench.world, {"rate_table": bench.table})
    assert {f"rate_table.interlock.{cause}" for cause in INTERLOCKS} <= set(offered)
    bench.start()
    write = offered["rate_table.interlock.door"].write
    assert write is not None
    write(True)  # noqa: FBT003  (as it comes over the wire)
    assert offered["rate_table.interlock.door"].read() is True
    assert offered["rate_table.shut_down_by"].read() == ["door"]
    with pytest.raises(ValueError, match="true or false"):
        write("open")


@pytest.mark.parametrize("kind", ["interlock", "door", "emergency_stop", "drive_fault", "jam"])
@pytest.mark.parametrize("name", TWINS)
def test_a_fault_script_throws_them_too(name: str, kind: Any) -> None:
    bench = Bench(name)
    injector = FaultInjector({"rate_table": bench.table}, bench.clock)
    bench.start()
    begun_s = bench.clock.now()
    injector.add(Fault("rate_table", kind, at_s=begun_s + 1.0, duration_s=1.0))
    bench.table = injector.devices["rate_table"]
    bench.wait(0.9)
    assert bench.rate_deg_s == pytest.approx(RATE, rel=1e-3)
    bench.wait(0.5)
    assert bench.rate_deg_s < 0.9 * RATE
    bench.wait(3.0)
    assert bench.rate_deg_s == pytest.approx(0.0, abs=1e-6)  # that the cause has gone does not set it turning again
