from __future__ import annotations

from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, cast, get_args

import pytest
from simrack.faults import Fault, FaultScript, Kind
from simrack.faulty_device import FaultInjector, FaultyDevice

import simrack
from vcfbench.clock import VirtualClock
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.fault_scripts import parse_script, read_script

if TYPE_CHECKING:
    from simrack.device import Device

    from vcfbench.clock import Clock

SCRIPT = """
seed = 7

[[fault]]
at_s = 10.0
instrument = "multimeter"
kind = "late"
duration_s = 5.0
delay_s = 3.0

[[fault]]
instrument = "power"
kind = "error"
number = -350
"""


class Echo:
    """Says what it hears; nothing happens by itself."""

    def __init__(self) -> None:
        self.said = b""
        self.cleared = 0

    def write(self, data: bytes, *, end: bool = False) -> None:
        del end
        self.said += data

    def read(self, limit: int) -> tuple[bytes, bool]:
        part, self.said = self.said[:limit], self.said[limit:]
        return part, bool(part) and not self.said

    def wake_at(self) -> float | None:
        return None

    def clear(self) -> None:
        self.cleared += 1
        self.said = b""

    def status_byte(self) -> int:
        return 16

    def trigger(self) -> None:
        self.said += b"triggered"


class Prompt(Echo):
    """Says at once what it hears, and is due until somebody has read it."""

    def wake_at(self) -> float | None:
        return 0.0 if self.said else None


def faulty(*faults: Fault, device: Device | None = None) -> tuple[FaultyDevice, VirtualClock]:
    clock = VirtualClock()
    wrapped = FaultyDevice(device or Echo(), clock, Random(1))  # noqa: S311
    for fault in faults:
        wrapped.add(fault)
    return wrapped, clock


def exchange(device: FaultyDevice, data: bytes = b"+1.234E+00\n") -> bytes:
    device.write(data, end=True)
    device.wake_at()
    return device.read(100)[0]


def test_a_script_is_read(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(SCRIPT, "utf-8")
    late, error = read_script(path).faults
    assert late == Fault("multimeter", "late", at_s=10.0, duration_s=5.0, delay_s=3.0)
    assert error == Fault("power", "error", number=-350)
    assert read_script(path) == FaultScript((late, error), seed=7)
    assert parse_script("", "empty") == FaultScript(())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[fault]", "f: expected TOML"),
        ("speed = 1", "f: expected only seed and"),
        ('seed = "a"', "f: expected only seed and"),
        ("fault = 3", "f: expected only seed and"),
        ('[[fault]]\nkind = "late"', "f: fault 1: expected instrument and kind"),
        ('[[fault]]\ninstrument = "power"\nkind = "late"\nuntil = 3', "f: fault 1: expected instrument and kind"),
        ('[[fault]]\ninstrument = "power"\nkind = "tired"', "f: fault 1: a fault is one of silent, late"),
        ('[[fault]]\ninstrument = "power"\nkind = "late"\nat_s = -1', "f: fault 1: a fault begins at 0 s or later"),
        ('[[fault]]\ninstrument = "power"\nkind = "late"\nat_s = "soon"', "f: fault 1: "),
    ],
)
def test_what_is_no_script_is_told(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=r"^f: ") as caught:
        parse_script(text, "f")
    assert words in str(caught.value)


OF_KINDS = {"delay_s": "late", "number": "error", "identity": "identity", "load_ohm": "current_limit"}
GIVEN = {"delay_s": 3.0, "number": -350, "identity": "A,B,0,0", "load_ohm": 5.0, "offset": 1.0, "drift_s": 0.1}


@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_field_of_another_kind_is_refused(kind: Kind) -> None:
    own = {name for name in GIVEN if OF_KINDS.get(name, "offset") == kind}
    for name in own:
        Fault("multimeter", kind, **{name: GIVEN[name]})
    for name in GIVEN.keys() - own:
        with pytest.raises(ValueError, match=f"^{name} is nothing of a fault {kind}, which has"):
            Fault("multimeter", kind, **{**{each: GIVEN[each] for each in own}, name: GIVEN[name]})


@pytest.mark.parametrize("name", OF_KINDS)
def test_a_field_without_a_value_has_the_default_of_the_page(name: str) -> None:
    page = (Path(simrack.__file__).parents[1] / "docs" / "faults.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| `{OF_KINDS[name]}` |"))
    default = getattr(Fault("multimeter", cast("Kind", OF_KINDS[name])), name)
    assert f"{default:g}" in row if isinstance(default, int | float) else default in row


def test_an_offset_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="offset or drift_s: expected one of them"):
        Fault("multimeter", "offset")


def test_without_faults_everything_passes() -> None:
    device, _ = faulty()
    device.write(b"abcdef")
    assert [device.read(4), device.read(4), device.read(4)] == [(b"abcd", False), (b"ef", True), (b"", False)]
    device.trigger()
    assert device.read(100) == (b"triggered", True)
    assert device.status_byte() == 16
    device.clear()
    assert device.cleared == 1
    assert device.wake_at() is None


def test_answers_are_lost_for_a_while() -> None:
    device, clock = faulty(Fault("x", "silent", at_s=1.0, duration_s=2.0))
    assert device.wake_at() == 1.0
    assert exchange(device) == b"+1.234E+00\n"
    clock.sleep_until(1.0)
    assert device.wake_at() == 3.0
    assert exchange(device) == b""
    clock.sleep_until(3.0)
    assert exchange(device) == b"+1.234E+00\n"


def test_answers_come_later_and_in_their_order() -> None:
    device, clock = faulty(Fault("x", "late", delay_s=2.0, duration_s=3.0))
    assert exchange(device, b"first\n") == b""
    assert device.wake_at() == 2.0
    clock.sleep_until(1.0)
    assert exchange(device, b"second\n") == b""
    clock.sleep_until(2.0)
    assert device.read(3) == (b"fir", False)
    assert device.read(100) == (b"st\n", True)
    assert device.read(100) == (b"", False)
    clock.sleep_until(4.0)
    assert device.read(100) == (b"second\n", True)


@pytest.mark.parametrize("seed", range(20))
def test_one_byte_is_noise(seed: int) -> None:
    device = FaultyDevice(Echo(), VirtualClock(), Random(seed))  # noqa: S311
    device.add(Fault("x", "garbled"))
    answer = exchange(device)
    assert sum(a != b for a, b in zip(answer, b"+1.234E+00\n", strict=True)) == 1
    assert answer.endswith(b"\n")
    assert not answer.isascii()


def test_noise_comes_before_the_answer_the_same_for_a_seed() -> None:
    answers = [exchange(faulty(Fault("x", "garbage"))[0]) for _ in range(2)]
    assert answers[0] == answers[1]
    assert answers[0].endswith(b"+1.234E+00\n")
    assert len(answers[0]) > 11


def test_half_an_answer() -> None:
    device, _ = faulty(Fault("x", "truncated"))
    device.write(b"abcdefgh\n")
    device.wake_at()
    assert device.read(100) == (b"abcd", False)


def test_a_connection_is_cut_once() -> None:
    device, clock = faulty(Fault("x", "disconnect", at_s=1.0))
    device.write(b"lost with it")
    clock.sleep_until(1.0)
    with pytest.raises(ConnectionResetError):
        device.read(100)
    assert exchange(device) == b"+1.234E+00\n"


def test_nobody_can_be_reached_for_a_while() -> None:
    device, clock = faulty(Fault("x", "unreachable", duration_s=5.0))
    for call in (lambda: device.write(b"a"), lambda: device.read(1), device.clear, device.status_byte, device.trigger):
        with pytest.raises(ConnectionResetError):
            call()
    clock.sleep_until(5.0)
    assert exchange(device) == b"+1.234E+00\n"


def test_faults_are_ended_and_forgotten() -> None:
    device, clock = faulty(Fault("x", "silent"), Fault("x", "silent", at_s=9.0), Fault("x", "disconnect"))
    device.clear_faults()
    clock.sleep_until(10.0)
    assert exchange(device) == b"+1.234E+00\n"


@pytest.mark.parametrize("kind", ["error", "overload", "current_limit", "interlock"])
def test_not_everything_can_suffer_everything(kind: str) -> None:
    with pytest.raises(ValueError, match=f"x does not have the fault '{kind}'"):
        faulty(Fault("x", kind))  # type: ignore[arg-type]


def built() -> tuple[SimulatedBench, FaultInjector, Clock]:
    bench = SimulatedBench.build(load_bench("ideal"), 0, VirtualClock())
    return bench, FaultInjector(bench.devices, bench.clock), bench.clock


def ask(injector: FaultInjector, clock: Clock, role: str, message: str) -> str:
    device = injector.devices[role]
    while device.read(1000)[0]:  # acknowledgements
        pass
    device.write(message.encode() + b"\n", end=True)
    for _ in range(100):
        answer = device.read(1000)[0]
        if answer or "?" not in message:
            break
        clock.sleep_until(max(device.wake_at() or 0.0, clock.now() + 0.01))
    return answer.decode().strip()


def test_the_multimeter_is_overloaded_as_long_as_it_lasts() -> None:
    _, injector, clock = built()
    injector.add(Fault("multimeter", "overload", duration_s=10.0))
    assert ask(injector, clock, "multimeter", "READ?") == "+9.90000000E+37"
    assert ask(injector, clock, "multimeter", "VOLT:RANG?") == "+1.00000000E+03"
    clock.sleep_until(11.0)
    injector.devices["multimeter"].wake_at()
    assert abs(float(ask(injector, clock, "multimeter", "READ?"))) < 1.0


def test_a_short_circuit_drives_the_supply_into_its_limit() -> None:
    bench, injector, clock = built()
    for message in ("APPL P25V,10,0.1", "APPL N25V,-10,0.1", "OUTP ON"):
        ask(injector, clock, "power", message)
    clock.sleep_until(2.0)
    injector.devices["power"].wake_at()
    assert bench.world.value_v("rail_positive") == pytest.approx(10.0, abs=0.01)
    injector.add(Fault("power", "current_limit"))
    clock.sleep_until(clock.now() + 0.01)
    assert bench.world.value_v("rail_positive") == pytest.approx(0.1, abs=0.01)
    assert ask(injector, clock, "power", "STAT:QUES:INST:ISUM2:COND?") in {"+1", "1"}
    injector.clear(["power"])
    clock.sleep_until(clock.now() + 0.1)
    assert bench.world.value_v("rail_positive") == pytest.approx(10.0, abs=0.01)


def test_the_interlock_of_the_table_opens() -> None:
    bench, injector, clock = built()
    for message in (":Demand:Rate 1,0;:Mode:Rate 1", ":Interlock:Close 1"):
        ask(injector, clock, "rate_table", message)
        clock.sleep_until(clock.now() + 1.0)
    clock.sleep_until(5.0)
    injector.devices["rate_table"].wake_at()
    assert bench.world.table.servo_closed
    injector.add(Fault("rate_table", "interlock"))
    clock.sleep_until(clock.now() + 1.0)
    assert not bench.world.table.servo_closed
    assert ask(injector, clock, "rate_table", ":Interlock? 1").endswith("Fault")


def test_an_error_is_in_the_queue() -> None:
    _, injector, clock = built()
    injector.add(Fault("power", "error", number=-350))
    assert ask(injector, clock, "power", "SYST:ERR?").startswith("-350")


def test_a_bench_knows_its_instruments() -> None:
    _, injector, _ = built()
    with pytest.raises(ValueError, match="the bench has no 'kettle', only power"):
        injector.add(Fault("kettle", "silent"))
    injector.play(parse_script(SCRIPT, "script"))
    injector.clear()


def test_as_many_answers_are_spoilt_as_are_said() -> None:
    device, _ = faulty(Fault("x", "silent", count=2))
    assert [exchange(device) for _ in range(3)] == [b"", b"", b"+1.234E+00\n"]
    assert device.wake_at() is None


def test_what_comes_after_late_answers_waits_for_them() -> None:
    """A device whose answer stood ready behind late ones woke its reader at an instant that was past, for ever."""
    device, clock = faulty(Fault("x", "late", delay_s=2.0, count=1), device=Prompt())
    assert exchange(device, b"first\n") == b""
    assert exchange(device, b"second\n") == b""
    assert device.wake_at() == 2.0
    clock.sleep_until(2.0)
    assert [device.read(100), device.read(100)] == [(b"first\n", True), (b"second\n", True)]
    assert device.wake_at() is None


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"kind": "overload", "count": 1}, "expected a number of damaged answers"),
        ({"kind": "late", "count": 0}, "expected a number of damaged answers"),
        ({"kind": "current_limit", "load_ohm": 0.0}, "a load has more than 0 ohm"),
    ],
)
def test_a_field_that_makes_no_sense_is_told(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Fault("x", **fields)


def test_a_half_open_link_takes_nothing_and_says_nothing() -> None:
    device, clock = faulty(Fault("x", "half_open", duration_s=5.0))
    assert exchange(device) == b""
    clock.sleep_until(5.0)
    assert device.read(100) == (b"", False)
    assert exchange(device) == b"+1.234E+00\n"


def test_a_supply_that_was_switched_off_is_as_switched_on() -> None:
    bench, injector, clock = built()
    for message in ("APPL P25V,10,0.1", "OUTP ON", "*SRE 32"):
        ask(injector, clock, "power", message)
    clock.sleep_until(2.0)
    injector.add(Fault("power", "power_cycle", duration_s=3.0))
    with pytest.raises(ConnectionResetError):
        ask(injector, clock, "power", "OUTP?")
    clock.sleep_until(6.0)
    injector.devices["power"].wake_at()
    assert bench.world.value_v("rail_positive") == pytest.approx(0.0, abs=1e-6)
    on, mask, events = map(int, ask(injector, clock, "power", "OUTP?;*SRE?;*ESR?").split(";"))
    assert (on, mask, events & 128) == (0, 0, 128)


def test_another_instrument_stands_there() -> None:
    _, injector, clock = built()
    before = ask(injector, clock, "multimeter", "*IDN?")
    injector.add(Fault("multimeter", "identity", identity="ACME,1,2,3", duration_s=10.0))
    assert ask(injector, clock, "multimeter", "*IDN?") == "ACME,1,2,3"
    clock.sleep_until(clock.now() + 10.0)
    injector.devices["multimeter"].wake_at()
    assert ask(injector, clock, "multimeter", "*IDN?") == before


def test_readings_are_off_and_drift_but_an_overload_stays_one() -> None:
    _, injector, clock = built()
    ask(injector, clock, "multimeter", "CONF:VOLT:DC 10")
    true_v = float(ask(injector, clock, "multimeter", "READ?"))
    begun_s = clock.now()
    injector.add(Fault("multimeter", "offset", offset=-2.0, drift_s=0.1))
    clock.sleep_until(begun_s + 10.0)
    assert float(ask(injector, clock, "multimeter", "READ?")) == pytest.approx(true_v - 2.0 + 1.0, abs=0.05)
    injector.add(Fault("multimeter", "overload"))
    assert ask(injector, clock, "multimeter", "READ?") == "+9.90000000E+37"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault("multimeter", "late"), "multimeter: late, delay_s 1.0, from 0 s of bench time until it is cleared"),
        (Fault("power", "silent", 3.5, 2.0, count=4), "power: silent, from 3.5 s of bench time for 2 s, or 4 answers"),
        (Fault("power", "error", 1.0, number=-350), "power: error, number -350, once at 1 s of bench time"),
        (
            Fault("multimeter", "offset", offset=0.5),
            "multimeter: offset, offset 0.5, drift_s 0.0, from 0 s of bench time until it is cleared",
        ),
    ],
)
def test_a_fault_says_what_it_is_and_for_how_long(fault: Fault, words: str) -> None:
    assert fault.describe() == words
