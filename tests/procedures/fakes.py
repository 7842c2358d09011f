"""A bench of plain objects with a straight-line gyro, for tests of plans and executor; no simulator in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from vcfbench.clock import VirtualClock, sleep
from vcfbench.drivers.hands import Hands
from vcfbench.errors import LinkLost, MeasurementError
from vcfbench.interfaces import Identity, Regulation, SafeReport, UnprovedCommand, Waveform
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.station.parts import DriveWindow, Expected
from vcfbench.station.settings import PlacedInstrument, Station

if TYPE_CHECKING:
    from vcfbench.clock import Deadline


CALIBRATIONS = ("turntable", "virtual-coriolis")
"""The procedures that visit the paper's rates."""


def make_settings(*, expected: Expected | None = None, **changes: Any) -> VirtualCoriolisSettings:
    """Return settings of both calibrations; turntable takes no notice of those that are not its own."""
    values: dict[str, Any] = {
        "drive": DriveWindow(frequency_hz=(3480.0, 3498.0), amplitude_v=(0.5, 4.0), phase_deg=(-10.0, 10.0)),
        "k_vc_guess_deg_s_per_v": 36.0,
        "station": Station(
            instruments={
                "power": PlacedInstrument(model="E3631A", where="FAKE"),
                "rate_source": PlacedInstrument(model="33220A", where="FAKE"),
            },
            meter_resolution_v=1e-5,
            expected=expected or Expected(),
        ),
    }
    return VirtualCoriolisSettings(**{**values, **changes})


@dataclass
class Gyro:
    """V = zero + leakage (generator on) + K (rate + k_vc V_Vc), with curvature of the virtual side and white noise."""

    scale_factor: float = -0.0125
    zero_v: float = -0.042
    leakage_v: float = 0.0517
    k_vc: float = 40.0
    curvature: float = 0.0
    noise_v: float = 0.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))


@dataclass
class FakeInstrument:
    bench: FakeBench
    name: str = "instrument"
    resource: str = "FAKE"
    lost: bool = False

    def log(self, call: str) -> None:
        if self.lost:
            raise LinkLost("the connection broke", instrument=self.name, resource=self.resource)
        self.bench.calls.append((self.bench.clock.now(), self.name, call))

    def identify(self) -> Identity:
        return Identity("fake", self.name, "0", "0")

    def check_errors(self) -> None:
        pass

    def command_safe(self) -> UnprovedCommand:
        return UnprovedCommand("to switch off", sent=True)

    def make_safe(self, deadline: Deadline) -> SafeReport:
        del deadline
        return SafeReport(self.name, self.resource, safe=True, detail="")

    def close(self) -> None:
        pass


@dataclass
class FakePower(FakeInstrument):
    levels: dict[str, float] = field(default_factory=dict)
    enabled: bool = False
    regulation_now: Regulation = Regulation.CONSTANT_VOLTAGE
    sag_v: float = 0.0

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        self.log(f"configure {output} {voltage_v:g} {current_limit_a:g}")
        self.levels[output] = voltage_v

    def enable_outputs(self) -> None:
        self.log("on")
        self.enabled = True

    def disable_outputs(self) -> None:
        self.log("off")
        self.enabled = False

    def outputs_enabled(self) -> bool:
        return self.enabled

    def measure_voltage_v(self, output: str) -> float:
        return self.levels[output] - self.sag_v

    def measure_current_a(self, output: str) -> float:
        del output
        return 0.03

    def regulation(self, output: str) -> Regulation:
        del output
        return self.regulation_now


@dataclass
class FakeGenerator(FakeInstrument):
    level_v: float = 0.0
    enabled: bool = False
    stuck: bool = False

    def configure_dc(self, voltage_v: float) -> float:
        self.log(f"configure {voltage_v:g}")
        self.level_v = voltage_v
        return voltage_v

    def set_dc(self, voltage_v: float) -> float:
        self.level_v = float(f"{voltage_v:.5g}")
        self.log(f"set {self.level_v:g}")
        return self.level_v

    def configure_sine(self, frequency_hz: float, amplitude_vpp: float, offset_v: float = 0.0) -> None:
        raise NotImplementedError

    def enable_output(self) -> None:
        self.log("on")
        self.enabled = not self.stuck

    def disable_output(self) -> None:
        self.log("off")
        self.enabled = False

    def output_enabled(self) -> bool:
        return self.enabled


@dataclass
class FakeMeter(FakeInstrument):
    reading_s: float = 0.4
    readings: int = 0
    overload_at: int | None = None

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        self.log(f"configure {range_v:g} {nplc:g}")

    def read_voltage_v(self) -> float:
        self.log("read")
        self.readings += 1
        sleep(self.bench.clock, self.reading_s)
        if self.readings == self.overload_at:
            raise MeasurementError("overload on the 10 V range", instrument=self.name, resource=self.resource)
        return self.bench.output_v()


@dataclass
class FakeVvcMeter(FakeMeter):
    """Its leads are on V_Vc; it can be left alone with a reading."""

    gain: float = 1.001
    offset_v: float = 0.0
    begun_s: float | None = None

    def begin_reading(self) -> None:
        self.log("begin")
        self.begun_s = self.bench.clock.now()

    def begun_reading_v(self) -> float:
        assert self.begun_s is not None
        self.bench.clock.sleep_until(max(self.bench.clock.now(), self.begun_s + self.reading_s))
        return self.v_vc_v()

    def read_voltage_v(self) -> float:
        self.log("read")
        sleep(self.bench.clock, self.reading_s)
        return self.v_vc_v()

    def v_vc_v(self) -> float:
        source = self.bench.rate_source
        return self.offset_v + self.gain * (source.level_v if source.enabled else 0.0)


@dataclass
class FakeScope(FakeInstrument):
    frequency_hz: float = 3488.9
    amplitude_v: float = 2.0
    phase_deg: float = 1.0
    growth_s: float = 0.127

    def configure_channel(self, channel: int, scale_v_per_div: float, offset_v: float = 0.0) -> None:
        self.log(f"channel {channel} {scale_v_per_div:.3g} {offset_v:g}")

    def configure_timebase(self, scale_s_per_div: float) -> None:
        self.log(f"timebase {scale_s_per_div:g}")

    def configure_trigger(self, channel: int, level_v: float = 0.0) -> None:
        self.log(f"trigger {channel} {level_v:g}")

    def acquire(self, *channels: int) -> None:
        self.log(f"acquire {channels}")

    def measure_frequency_hz(self, channel: int) -> float:
        if not self.bench.power.enabled:
            raise MeasurementError(f"channel {channel}: no frequency", instrument=self.name, resource=self.resource)
        return self.frequency_hz

    def measure_amplitude_v(self, channel: int) -> float:
        del channel
        return self.amplitude_v * (1.0 - float(np.exp(-self.bench.clock.now() / self.growth_s)))

    def measure_phase_deg(self, channel: int, reference: int) -> float:
        del channel, reference
        return self.phase_deg

    def waveform(self, channel: int, points: int = 1000) -> Waveform:
        del channel
        time_s = 5e-3 / points * np.arange(points)
        return Waveform(time_s, self.amplitude_v * np.cos(2.0 * np.pi * self.frequency_hz * time_s))


@dataclass
class FakeTable(FakeInstrument):
    start_s: float = 0.0
    start_deg_s: float = 0.0
    demand_deg_s: float = 0.0
    acceleration_deg_s2: float = 1.0
    servo: bool = False
    fault_at_s: float | None = None
    ceiling_deg_s: float = 1e9

    def enable(self) -> None:
        self.log("enable")
        self.servo = True

    def disable(self) -> None:
        self.log("disable")
        self.servo = False

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        self.log(f"rate {rate_deg_s:g}")
        self.start_deg_s, self.start_s = self.true_rate(), self.bench.clock.now()
        self.demand_deg_s, self.acceleration_deg_s2 = rate_deg_s, acceleration_deg_s2

    def true_rate(self) -> float:
        step = self.demand_deg_s - self.start_deg_s
        gone = self.acceleration_deg_s2 * (self.bench.clock.now() - self.start_s)
        # a ramp ends at its demand exactly, whatever rounding the product of time and acceleration has
        rate = self.demand_deg_s if gone >= abs(step) - 1e-9 else self.start_deg_s + float(np.sign(step)) * gone
        return float(np.clip(rate, -self.ceiling_deg_s, self.ceiling_deg_s))

    def at_rate(self) -> bool:
        return self.true_rate() == self.demand_deg_s

    def rate_deg_s(self) -> float:
        self.log("read")
        return self.true_rate()

    def angle_deg(self) -> float:
        return 0.0

    def stop(self, acceleration_deg_s2: float) -> None:
        self.set_rate(0.0, acceleration_deg_s2)

    def fault(self) -> str | None:
        late = self.fault_at_s is not None and self.bench.clock.now() >= self.fault_at_s
        return "over-speed trip" if late else None


class FakeBench:
    """What steps ask :class:`vcfbench.Bench` for; `calls` holds (bench time, instrument, call)."""

    simulated_roles: tuple[str, ...] = ()

    def __init__(self, gyro: Gyro | None = None) -> None:
        self.clock = VirtualClock()
        self.calls: list[tuple[float, str, str]] = []
        self.gyro = gyro or Gyro()
        self.power = FakePower(self, "power", "FAKE::5")
        self.rate_source = FakeGenerator(self, "rate_source", "FAKE::10")
        self.multimeter = FakeMeter(self, "multimeter", "FAKE::22")
        self.oscilloscope = FakeScope(self, "oscilloscope", "FAKE::7")
        self.rate_table = FakeTable(self, "rate_table", "FAKE::COM1")
        self.v_vc_meter: FakeMeter = FakeVvcMeter(self, "v_vc_meter", "FAKE::23")
        self.instruments: dict[str, Any] = {}  # none of these has an error queue
        self.answers: list[str] = []
        self.watchdog = None
        self.left_by: dict[str, str] = {}
        self.hands = Hands()
        self.by_hand: tuple[str, ...] = ()

    def disbelieve(self, instrument: str, why: str) -> None:
        self.calls.append((self.clock.now(), instrument, f"disbelieved: {why}"))

    def output_v(self) -> float:
        gyro, source = self.gyro, self.rate_source
        v_vc = source.level_v if source.enabled else 0.0
        virtual = gyro.k_vc * v_vc * (1.0 + gyro.curvature * v_vc)
        leakage = gyro.leakage_v if source.enabled else 0.0
        signal = gyro.zero_v + leakage + gyro.scale_factor * (self.rate_table.true_rate() + virtual)
        return signal + gyro.noise_v * float(gyro.rng.standard_normal())


class MemoryJournal:
    """Keeps the lines in a list."""

    def __init__(self) -> None:
        self.lines: list[dict[str, Any]] = []

    def write(self, kind: str, values: Any) -> None:
        self.lines.append({"type": kind, **values})
