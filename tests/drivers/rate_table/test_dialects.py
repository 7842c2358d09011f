"""Every dialect on its simulated table: what the driver promises holds for each, judged by the table's true motion."""

from __future__ import annotations

import math
from contextlib import suppress
from random import Random
from typing import TYPE_CHECKING, Any

import pytest
from simrack.attendance import AttendedClock
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.acl import AclTable
from simrack.rate_tables.atl import AtlTable
from simrack.rate_tables.axis import TableErrors
from simrack.rate_tables.dd16 import Dd16Table
from simrack.rate_tables.esp import EspTable
from simrack.rate_tables.mn_as import MnAsTable
from simrack.rate_tables.ruya import RuyaTable
from simrack.rate_tables.zaber import StepperErrors, ZaberTable
from simrack.wires import serial_backend
from simrack_tests.cells import few

from tests.drivers.rate_table import DIALECTS, SHIPPED
from vcfbench.clock import Deadline, VirtualClock, sleep
from vcfbench.drivers.rate_table.dialect import TableSettings, spoken
from vcfbench.drivers.registry import open_instrument
from vcfbench.errors import ConfigError, InstrumentError, InterlockError, LimitError, LinkLost, TransportError
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from simrack.device import Device

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
ANSWERING = [name for name in DIALECTS if name not in ("ruya", "aaaa")]
LIMITS = {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0}


class Muffled:
    """A device whose next replies get lost, or come late and hold up those behind them."""

    def __init__(self, device: Device, clock: AttendedClock) -> None:
        self.device = device
        self.clock = clock
        self.losing = 0
        self.late_s = 0.0
        self._held: list[tuple[float, bytes]] = []

    def write(self, data: bytes, *, end: bool = False) -> None:
        self.device.write(data, end=end)

    def read(self, limit: int) -> tuple[bytes, bool]:
        while self.losing and self.device.read(limit)[0]:
            self.losing -= 1
        data = self.device.read(limit)[0]
        if data and (self.late_s or self._held):
            ready_s = max(self.clock.now() + self.late_s, self._held[-1][0] if self._held else 0.0)
            self._held.append((ready_s, data))
            self.late_s, data = 0.0, b""
        if not data and self._held and self._held[0][0] <= self.clock.now():
            data = self._held.pop(0)[1]
        return data, bool(data)

    def wake_at(self) -> float | None:
        self.device.wake_at()
        held = [self._held[0][0]] if self._held else []
        wakes = [*held, *([own] if (own := self.device.wake_at()) is not None else [])]
        return min(wakes, default=None)


class Bench:
    """A table on simulated time, and its driver."""

    def __init__(self, name: str, **settings: Any) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.world = World(self.clock, ideal_bench(), 0)
        errors = StepperErrors.none() if name == "zaber" else TableErrors.none()
        self.twin = Muffled(TWINS[name](self.world, errors=errors), self.clock)
        self.clock.attend(self.twin)
        serial_backend.register("dialects", self.twin, self.clock)  # type: ignore[arg-type]
        asked_settings = {**LIMITS, **settings, **({"steps_per_deg": 640000 / 360} if name == "zaber" else {})}
        self.driver: Any = open_instrument(
            "rate_table", name, "sim://dialects", library="", clock=self.clock, settings=asked_settings
        )

    def wait(self, seconds: float) -> None:
        sleep(self.clock, seconds)

    def reach(self, rate_deg_s: float) -> None:
        self.driver.set_rate(rate_deg_s, 100.0)
        deadline = Deadline.after(self.clock, 20.0)
        while not self.driver.at_rate():
            assert not deadline.expired(), "the rate was not reached"
            self.wait(0.05)
        self.wait(0.5)


@pytest.fixture(autouse=True)
def _unplugged() -> Iterator[None]:
    yield
    serial_backend.unregister("dialects")


@pytest.mark.parametrize("name", DIALECTS)
def test_rates_are_reached_and_read_back(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    quantum = spoken(name, TableSettings(steps_per_deg=640000 / 360))[0].rate_quantum_deg_s
    for rate in (10.0, -20.0, 0.5, -0.1, 0.0):
        bench.reach(rate)
        assert bench.world.table.rate_deg_s() == pytest.approx(rate, abs=quantum)
        assert bench.driver.rate_deg_s() == pytest.approx(rate, abs=2e-3)
        assert bench.driver.fault() is None


@pytest.mark.parametrize("draws", [12, pytest.param(1000, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("name", [name for name in DIALECTS if name != "aaaa"])  # it comes to the end of its travel
def test_every_rate_and_acceleration_is_taken_whatever_went_before(name: str, draws: int) -> None:
    """Down to the least that each can be told."""
    random, bench = Random(0), Bench(name)  # noqa: S311  # rates, no secrets
    bench.driver.enable()
    quantum = bench.driver.dialect.rate_quantum_deg_s
    for _ in range(draws):
        size, most = (
            math.exp(random.uniform(math.log(low), math.log(high))) for low, high in ((quantum, 300.0), (4, 200))
        )
        rate = random.choice((-1.0, 1.0)) * size
        assert bench.driver.realised_deg_s(rate) == pytest.approx(rate, rel=1e-12, abs=0.5001 * quantum)
        bench.driver.set_rate(rate, most)
        bench.wait(random.choice((0.05, 60.0)))
        bench.driver.check_errors()


@pytest.mark.parametrize("name", DIALECTS)
def test_angles_count_the_way_the_table_turns(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(10.0)
    read_deg, true = bench.driver.angle_deg(), bench.world.table.angle_deg()
    bench.wait(1.0)
    turned = (bench.driver.angle_deg() - read_deg + 180.0) % 360.0 - 180.0
    assert turned == pytest.approx(bench.world.table.angle_deg() - true, abs=3.0)
    assert turned > 8.0


@pytest.mark.parametrize("name", DIALECTS)
def test_safe_is_at_rest_and_servo_open(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(-50.0)
    report = bench.driver.make_safe(Deadline.after(bench.clock, 20.0))
    assert report.safe, report.detail
    assert abs(bench.world.table.rate_deg_s()) < 0.01
    assert not bench.world.table.servo_closed


@pytest.mark.parametrize("name", ANSWERING)
def test_safe_in_spite_of_lost_answers(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(50.0)
    bench.twin.losing = 2
    report = bench.driver.make_safe(Deadline.after(bench.clock, 40.0))
    assert report.safe, report.detail
    assert abs(bench.world.table.rate_deg_s()) < 0.01


@pytest.mark.parametrize("name", DIALECTS)
def test_a_lost_answer_is_not_a_wrong_one(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(10.0)
    for losing in (1, 1, 0):
        bench.twin.losing = losing
        assert bench.driver.rate_deg_s() == pytest.approx(10.0, abs=2e-3)


@pytest.mark.parametrize("name", few(ANSWERING, every=5))
@pytest.mark.parametrize("late_s", [1.95, 2.01, 2.1, 2.5, 3.9, 4.05])
def test_a_late_answer_is_never_taken_for_another(name: str, late_s: float) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(10.0)
    bench.twin.late_s = late_s
    for _ in range(4):
        asked_deg = bench.world.table.angle_deg()
        try:
            angle_deg, rate_deg_s = bench.driver.angle_deg(), bench.driver.rate_deg_s()
        except TransportError:
            return  # no answer is better than a wrong one; the line is closed and the bench makes itself safe
        turned_deg = bench.world.table.angle_deg() - asked_deg
        assert -0.01 <= (angle_deg - asked_deg + 90.0) % 360.0 - 90.0 <= turned_deg  # read since it was asked for
        assert rate_deg_s == pytest.approx(10.0, abs=2e-3)


def test_low_jerk_limit_delays_at_rate_and_rest() -> None:
    """Of 100 deg/s3 a ramp to 60 deg/s at 100 deg/s2 takes 2 sqrt(60/100) = 1.55 s instead of 0.6."""
    bench = Bench("acl")
    bench.twin.write(b":Limit:Jerk R,1,100;Jerk Off,1,100\n")
    bench.wait(0.5)
    bench.twin.read(1000)
    bench.driver.enable()
    start = bench.clock.now()
    bench.driver.set_rate(60.0, 100.0)
    while not bench.driver.at_rate():
        bench.wait(0.01)
    assert bench.clock.now() - start == pytest.approx(2.0 * math.sqrt(60.0 / 100.0), abs=0.2)
    bench.wait(0.1)
    assert bench.driver.rate_deg_s() == pytest.approx(60.0, abs=1e-3)
    report = bench.driver.make_safe(Deadline.after(bench.clock, 10.0))
    assert report.safe
    assert bench.clock.now() - start < 5.0


@pytest.mark.parametrize("name", DIALECTS)
def test_a_table_found_turning_is_not_started(name: str) -> None:
    bench = Bench(name)
    bench.world.table.close_servo()
    bench.world.table.demand_rate(30.0, 1000.0)
    bench.wait(1.0)
    with pytest.raises(InterlockError, match=r"found turning at (30|29\.9999) deg/s"):
        bench.driver.enable()
    assert bench.world.table.profile_rate_deg_s() == 30.0


@pytest.mark.parametrize("name", DIALECTS)
def test_the_servo_of_a_turning_table_is_not_opened(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(5.0)
    with pytest.raises(InterlockError, match="was told 5 deg/s"):
        bench.driver.disable()
    if name != "acl":  # whose Open is itself an orderly shutdown
        dialect = bench.driver.dialect
        with pytest.raises(InterlockError, match="the servo was not opened"):
            dialect.open_servo(bench.driver.line, bench.driver.line.deadline())
    assert bench.world.table.servo_closed
    assert bench.world.table.profile_rate_deg_s() == pytest.approx(5.0, abs=1e-3)


@pytest.mark.parametrize("name", DIALECTS)
def test_settling_table_is_waited_for_and_turning_one_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(5.0)
    bench.driver.set_rate(0.0, 100.0)
    bench.clock.sleep_until(bench.clock.now() + 5.0)
    read = iter([0.049, -0.052])
    truly = bench.driver.rate_deg_s
    monkeypatch.setattr(bench.driver, "rate_deg_s", lambda: next(read, None) or truly())
    bench.driver.disable()
    assert not bench.world.table.servo_closed
    bench.driver.enable()
    monkeypatch.setattr(bench.driver.dialect, "rate_deg_s", lambda _line, _deadline: -0.052)
    with pytest.raises(InterlockError, match=r"still turns at -0\.052"):
        bench.driver.disable()
    assert bench.world.table.servo_closed


@pytest.mark.parametrize("name", DIALECTS)
@pytest.mark.parametrize("rate", [math.nan, math.inf, 300.1])
def test_what_is_beyond_the_limits_does_not_reach_the_table(name: str, rate: float) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(1.0)
    with pytest.raises(LimitError):
        bench.driver.set_rate(rate, 100.0)
    assert bench.world.table.profile_rate_deg_s() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", few(DIALECTS, every=4))
def test_table_turns_on_without_host_and_can_be_stopped(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(20.0)
    bench.driver.line.locate(LinkLost("the cable is off"), None, bench.driver.line.deadline())
    bench.wait(20.0)
    assert bench.world.table.profile_rate_deg_s() == pytest.approx(20.0, abs=1e-3)
    report = bench.driver.make_safe(Deadline.after(bench.clock, 20.0))
    assert report.safe, report.detail
    assert abs(bench.world.table.rate_deg_s()) < 0.01


@pytest.mark.parametrize("name", SHIPPED)
def test_a_table_of_the_other_sign(name: str) -> None:
    bench = Bench(name, axis_sign=-1)
    bench.driver.enable()
    bench.reach(10.0)
    assert bench.world.table.rate_deg_s() == pytest.approx(-10.0, abs=1e-3)


@pytest.mark.parametrize("unit", [7, 8, 9, 10, 11])
def test_esp_stage_reaches_its_rate_whatever_unit_was_set(unit: int) -> None:
    bench = Bench("esp")
    bench.twin.device._unit = unit  # type: ignore[attr-defined]
    bench.driver.identify()
    bench.driver.enable()
    for rate in (10.0, -150.0, 0.5):
        bench.reach(rate)
        assert bench.world.table.rate_deg_s() == pytest.approx(rate, abs=6e-3)
        assert bench.driver.rate_deg_s() == pytest.approx(rate, abs=6e-3)


@pytest.mark.parametrize("name", ["esp", "ruya"])
@pytest.mark.parametrize("acceleration_deg_s2", [30.0, 100.0])
def test_a_table_that_stops_before_it_reverses_is_waited_for(name: str, acceleration_deg_s2: float) -> None:
    """Longer than an answer may take: what is told it afterwards has a time of its own."""
    bench = Bench(name)
    bench.driver.enable()
    for rate in (250.0, -250.0):
        bench.driver.set_rate(rate, acceleration_deg_s2)
        bench.wait(20.0)
        assert bench.world.table.rate_deg_s() == pytest.approx(rate, abs=0.01)


def test_ruya_stops_before_each_change_of_rate() -> None:
    bench = Bench("ruya")
    bench.driver.enable()
    bench.reach(100.0)
    started_s = bench.clock.now()
    bench.driver.set_rate(50.0, 10.0)
    assert bench.clock.now() - started_s > 1.0  # 100 deg/s at the 100 deg/s2 of the run that is left
    assert 0.0 < bench.world.table.profile_rate_deg_s() < 10.0


def test_aaaa_comes_to_rest_at_the_end_of_travel() -> None:
    bench = Bench("aaaa")
    bench.driver.enable()
    bench.reach(200.0)
    bench.wait(10.0)
    assert bench.driver.angle_deg() == pytest.approx(838.8607, abs=2e-4)
    assert not bench.driver.at_rate()
    with pytest.raises(InterlockError, match=r"at \+200 deg/s, it stands at the end of its travel, \+838\.9 deg"):
        bench.driver.rate_deg_s()
    assert bench.driver.make_safe(Deadline.after(bench.clock, 10.0)).safe


def test_aaaa_reports_end_of_travel_in_bench_sign() -> None:
    bench = Bench("aaaa", axis_sign=-1)
    bench.driver.enable()
    bench.reach(200.0)
    bench.wait(10.0)
    with pytest.raises(InterlockError, match=r"at \+200 deg/s, it stands at the end of its travel, \+838\.9 deg"):
        bench.driver.rate_deg_s()


@pytest.mark.parametrize(("rate_deg_s", "sign"), [(200.0, 1), (-200.0, 1), (200.0, -1)])
def test_aaaa_enabled_near_end_of_travel_is_wound_back(rate_deg_s: float, sign: int) -> None:
    bench = Bench("aaaa", axis_sign=sign)
    bench.driver.enable()
    bench.reach(rate_deg_s)
    bench.wait(5.0)
    assert bench.driver.make_safe(Deadline.after(bench.clock, 10.0)).safe
    assert abs(bench.driver.angle_deg()) > 500.0
    began_s = bench.clock.now()
    bench.driver.enable()
    assert bench.clock.now() - began_s > 500.0 / 30.0
    assert bench.driver.angle_deg() == pytest.approx(0.0, abs=0.1)
    assert bench.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-9)
    bench.reach(rate_deg_s)
    assert bench.driver.rate_deg_s() == pytest.approx(rate_deg_s, abs=2e-3)


def test_aaaa_that_does_not_wind_back_is_not_enabled() -> None:
    bench = Bench("aaaa", max_rate_deg_s=10.0)
    bench.driver.enable()
    bench.reach(10.0)
    bench.wait(75.0)
    assert bench.driver.make_safe(Deadline.after(bench.clock, 10.0)).safe
    with pytest.raises(
        InterlockError, match=r"\+7\d\d\.\d deg, away from the middle .*; at 10 deg/s winding back takes 7\d s"
    ):
        bench.driver.enable()
    with pytest.raises(InterlockError, match="servo is open"):
        bench.driver.set_rate(10.0, 100.0)


def test_a_zaber_stage_must_be_told_its_steps() -> None:
    with pytest.raises(ConfigError, match=r"rate_table\.steps_per_deg: give the stage's microsteps per degree"):
        spoken("zaber", TableSettings())


@pytest.mark.parametrize("prompting", [True, False])
def test_atl_without_the_prompt_after_jog(prompting: bool) -> None:  # noqa: FBT001
    bench = Bench("atl")
    bench.twin.device = AtlTable(bench.world, TableErrors.none(), prompt_after_motion=prompting)
    bench.driver.enable()
    for rate in (10.0, -10.0):
        bench.reach(rate)
        assert bench.driver.rate_deg_s() == rate
    bench.driver.stop(100.0)
    bench.wait(1.0)
    assert bench.driver.rate_deg_s() == 0.0


# The words that stop a table, sent blind


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("name", few(DIALECTS, every=4))
def test_table_without_replies_is_stopped_and_reported_unsafe(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(50.0)
    assert bench.driver.rate_deg_s() == pytest.approx(50.0, abs=2e-3)
    bench.twin.losing = 1 << 60
    report = bench.driver.make_safe(Deadline.after(bench.clock, 30.0))
    assert not report.safe
    assert abs(bench.world.table.rate_deg_s()) < 0.01
    assert report.unproved.sent
    assert report.unproved.words == "to stop"
    assert report.unproved.last_read in {"50 deg/s", "-50 deg/s"} or float(report.unproved.last_read.split()[0]) < 51.0


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("name", few(DIALECTS, every=4))
def test_the_words_come_through_behind_any_part_of_a_command(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of a torn message must not swallow them."""
    bench = Bench(name)
    bench.driver.enable()
    wire = bench.driver.line._wire
    sent: list[bytes] = []
    send = wire.send
    monkeypatch.setattr(wire, "send", lambda data, deadline: (sent.append(data), send(data, deadline)))
    bench.reach(20.0)
    demand = sent[-1] if name in ("dd16", "aaaa") else max(sent, key=len)
    for cut in {1, 2, len(demand) // 2, len(demand) - 2, len(demand) - 1}:
        bench.reach(20.0)
        wire.send(demand[:cut], bench.driver.line.deadline())
        assert bench.driver.command_safe().sent
        bench.wait(3.0)  # half an acceleration is one too
        assert abs(bench.world.table.rate_deg_s()) < 0.01, demand[:cut]
        with suppress(InstrumentError):  # what half a command is to the table
            bench.driver.check_errors()


@pytest.mark.parametrize("name", ["acl", "zaber", "atl", "esp", "mn_as"])
def test_slow_table_is_told_to_brake_within_its_limit(name: str) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.driver.set_rate(200.0, 20.0)
    bench.wait(13.0)
    assert bench.world.table.rate_deg_s() == pytest.approx(200.0, abs=0.1)
    bench.driver.command_safe()
    bench.wait(3.5)
    assert abs(bench.world.table.rate_deg_s()) < 0.01


@pytest.mark.parametrize("header", ["u32le2", "u32be2"])
def test_acknowledged_words_are_not_taken_for_answers(header: str) -> None:
    bench = Bench("acl")
    bench.twin.device = AclTable(bench.world, TableErrors.none(), header=header)
    bench.driver.close()
    bench.driver = open_instrument(
        "rate_table",
        "acl",
        "sim://dialects",
        library="",
        clock=bench.clock,
        settings={**LIMITS, "reply_header": header},
    )
    bench.driver.enable()
    bench.reach(50.0)
    for _ in range(3):
        bench.driver.command_safe()
    bench.wait(2.0)
    assert bench.driver.rate_deg_s() == pytest.approx(0.0, abs=1e-3)
    report = bench.driver.make_safe(Deadline.after(bench.clock, 20.0))
    assert report.safe, report.detail


@pytest.mark.parametrize("name", DIALECTS)
def test_words_leave_before_anything_is_asked(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(name)
    bench.driver.enable()
    bench.reach(20.0)
    words = b"".join(bench.driver.dialect.stop_words(None))
    wire = bench.driver.line._wire
    done: list[bytes] = []
    send, receive = wire.send, wire.receive
    monkeypatch.setattr(wire, "send", lambda data, deadline: (done.append(data), send(data, deadline)))
    monkeypatch.setattr(wire, "receive", lambda deadline: (done.append(b"?"), receive(deadline))[1])
    assert bench.driver.make_safe(Deadline.after(bench.clock, 30.0)).safe
    assert b"".join(done[: done.index(b"?")]).startswith(words)
