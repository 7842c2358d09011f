"""Readings that a multimeter takes by itself, on an interval of its own: what goes over the wire, and the twins."""

from __future__ import annotations

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.drivers.openings import NO_ERROR, opening
from vcfbench.clock import sleep
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError, LimitError, MeasurementError
from vcfbench.interfaces import SamplesVoltage, lacking
from vcfbench.sim.served import on_wires
from vcfbench.testing import Exchange, expected_exchange, over_visa, serve_simulated

OPENING = opening("HEWLETT-PACKARD,34401A,0,10-5-2")
OPEN = over_visa(Hp34401A, name="multimeter")
STARTED: list[Exchange] = [
    ("ZERO:AUTO ONCE", None),
    ("SAMP:COUN 3", None),
    ("TRIG:DEL 0.8", None),
    NO_ERROR,
    ("SAMP:COUN?", "+3"),
    ("INIT", None),
]
THREE = "+1.00000000E-01,-1.00000000E-01,+1.20000000E-01"
SINGLE: list[Exchange] = [("SAMP:COUN 1", None), ("TRIG:DEL:AUTO ON", None), ("ZERO:AUTO ON", None), NO_ERROR]


def fetched(first: str, again: str) -> list[Exchange]:
    return [*OPENING, *STARTED, ("FETC?", first), ("FETC?", again)]


def test_meter_samples_by_itself_and_is_set_back() -> None:
    """10 power-line cycles at 50 Hz are 0.2 s of each second."""
    with expected_exchange(OPEN, [*fetched(THREE, THREE), *SINGLE]) as meter:
        assert meter.start_sampling(3, 1.0) == pytest.approx(3.05)
        assert meter.sampled_voltages_v() == (0.1, -0.1, 0.12)


@pytest.mark.parametrize(
    ("again", "error"),
    [
        (THREE.replace("2", "3"), FramingError),
        ("+1.00000000E-01,-1.00000000E-01", FramingError),
        (THREE.replace("2", ""), FramingError),
        (THREE.replace("+1.20000000E-01", "+9.90000000E+37"), MeasurementError),
    ],
)
def test_readings_that_differ_or_are_invalid_are_refused(again: str, error: type[Exception]) -> None:
    with expected_exchange(OPEN, fetched(THREE, again)) as meter:
        meter.start_sampling(3, 1.0)
        with pytest.raises(error):
            meter.sampled_voltages_v()


def test_too_few_readings_are_refused() -> None:
    two = "+1.00000000E-01,-1.00000000E-01"
    with expected_exchange(OPEN, fetched(two, two)) as meter:
        meter.start_sampling(3, 1.0)
        with pytest.raises(FramingError, match="2 readings came, 3 were taken"):
            meter.sampled_voltages_v()


@pytest.mark.parametrize(("samples", "interval_s"), [(513, 1.0), (0, 1.0), (3, 0.19), (3, float("nan")), (3, 1e9)])
def test_samples_beyond_memory_or_integration_time_are_not_sent(samples: int, interval_s: float) -> None:
    with expected_exchange(OPEN, OPENING) as meter, pytest.raises(LimitError, match="nothing was sent"):
        meter.start_sampling(samples, interval_s)


def test_another_number_of_readings_than_asked_for_is_an_error() -> None:
    exchanges = [*OPENING, *STARTED[:4], ("SAMP:COUN?", "+1")]
    with (
        expected_exchange(OPEN, exchanges) as meter,
        pytest.raises(InstrumentError, match="3 readings but reads back 1"),
    ):
        meter.start_sampling(3, 1.0)


# --- on the simulated meters ---


def paper_with(model: str) -> vcfbench.BenchDescription:
    paper = vcfbench.load_bench()
    assert paper.multimeter is not None
    return structs.replace(paper, multimeter=structs.replace(paper.multimeter, model=model))


def sampler(bench: vcfbench.Bench) -> SamplesVoltage:
    meter = bench.multimeter
    assert isinstance(meter, SamplesVoltage)
    meter.configure_dc_voltage(10.0, 10.0)
    return meter


@pytest.mark.parametrize(
    ("model", "most"),
    few([("34401A", 512), ("34461A", 10_000), ("34465A", 50_000), ("2000", 1024), ("DMM6500", 100_000)], every=2),
)
def test_readings_of_one_integration_time_each_leave_no_gap(model: str, most: int) -> None:
    """That many integration times it takes, and the meter's arming."""
    with vcfbench.open_bench(paper_with(model), needs=["multimeter"]) as bench:
        meter = sampler(bench)
        began_s = bench.clock.now()
        due_s = began_s + meter.start_sampling(500, 0.2)
        bench.clock.sleep_until(began_s + 100.0)
        readings_v = meter.sampled_voltages_v()
        assert bench.clock.now() - began_s == pytest.approx(100.02, abs=1e-6)
        assert bench.clock.now() <= due_s
        assert len(readings_v) == 500
        assert len(set(readings_v)) > 2
        single_v = meter.read_voltage_v()
        assert max(readings_v) - min(readings_v) < 1e-3
        assert single_v == pytest.approx(readings_v[-1], abs=1e-3)
        with pytest.raises(LimitError):
            meter.start_sampling(most + 1, 0.2)


def test_an_interval_is_kept_by_the_meter() -> None:
    with vcfbench.open_bench(needs=["multimeter"]) as bench:
        meter = sampler(bench)
        began_s = bench.clock.now()
        meter.start_sampling(5, 1.0)
        sleep(bench.clock, 5.0)
        assert len(meter.sampled_voltages_v()) == 5
        assert bench.clock.now() - began_s == pytest.approx(5.02, abs=1e-6)


def test_readings_that_are_asked_for_too_early_do_not_come() -> None:
    with vcfbench.open_bench(needs=["multimeter"]) as bench:
        meter = sampler(bench)
        meter.start_sampling(60, 1.0)
        with pytest.raises(DeadlineExceeded):
            meter.sampled_voltages_v()


@pytest.mark.parametrize("wires", ["tcp", "pty"])
def test_over_real_wires_they_are_the_same(wires: str) -> None:
    def sampled(bench: vcfbench.Bench) -> tuple[float, ...]:
        meter = sampler(bench)
        sleep(bench.clock, meter.start_sampling(100, 0.2))
        return meter.sampled_voltages_v()

    with vcfbench.open_bench(seed=3, needs=["multimeter"]) as bench:
        here = sampled(bench)
    with serve_simulated(seed=3) as lab:
        resources = {role: str(getattr(each, wires) or each.tcp) for role, each in lab.wires.items()}
        description = on_wires(lab.description, resources, f"127.0.0.1:{lab.control_port}")
        with vcfbench.open_bench(description, needs=["multimeter"]) as bench:
            assert sampled(bench) == here


def test_who_samples_can_be_asked_for_as_a_capability() -> None:
    assert lacking(Hp34401A, SamplesVoltage) == ()
    assert "start_sampling" in lacking(vcfbench.Multimeter, SamplesVoltage)
