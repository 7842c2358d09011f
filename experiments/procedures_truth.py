"""Whether what the procedures state is true: each on gyroscopes and benches that are drawn anew for every seed.

    python experiments/procedures_truth.py zero 0:200 --lines zero.jsonl      seeds 0 to 199, a line each
    python experiments/procedures_truth.py --summary zero.jsonl warmup.jsonl
    python experiments/procedures_truth.py                                    names what can be asked for

The truth is a closed form of the parameters (docs/theory.md), which the simulation does not use, of a gyroscope
without noise: what flicker does to a bias is the business of its uncertainty. Gyroscopes and instruments are drawn
here, by numbers that have no part in the program: the generator's ranges break where no budget expects it, within the
data sheet all the same. For each value the summary has z = (value - truth) / u and how often U95 holds the truth; of a
bound, how often the truth is below. The same seeds give the same bytes. What stands in the file of --lines is not run
again. Records are kept in memory where there is a /dev/shm. The exit code is 1 where something is beyond the limits.

A procedure is a row of STUDIES: a function of a seed and a directory that yields `Stated` values.
"""

from __future__ import annotations

import argparse
import cmath
import json
import math
import os
import sys
import tempfile
import tomllib
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from limits import outside, scores
from msgspec import structs

import vcfbench
from vcfbench import steps
from vcfbench.errors import MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim import world
from vcfbench.sim.simulation import physical_parameters, true_output
from vcfbench.studies.truth import turntable_truth
from vcfbench.testing import gyroscopes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from vcfbench.archive.run import Run
    from vcfbench.station.description import BenchDescription

    Line = dict[str, Any]

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile
BEYOND = "  * "
"""Before what is beyond the limits."""
SIGMAS = 4.0
"""Of a 34401A's limits: its maker says that they are better than so many standard deviations."""
METER_LIMITS = 35e-6, 50e-6
"""Limits of a 34401A a year after calibration on 10 V: of the reading, and V (User's Guide p. 216).

A specimen is as far within the limits of its other ranges.
"""


class Stated(NamedTuple):
    """A value as it is stated, and the truth of it; without `u` it is a bound that the truth should be below."""

    name: str
    value: float
    truth: float
    u: float | None = None
    u95: float | None = None


def stated(name: str, found: Any, truth: float) -> Iterator[Stated]:
    """Yield a measurand, a stated value or an estimate beside its truth; nothing where it was not found."""
    if found is None or not found.u:
        return
    halves = (getattr(found, key, None) for key in ("expanded_u", "u95", "u_95"))
    yield Stated(name, found.value, truth, found.u, next((each for each in halves if each is not None), None))


def as_told(found: Any, split_hz: float) -> float:
    """Return the true split, or its size where no sign is told."""
    return split_hz if found is not None and found.value < 0.0 else abs(split_hz)


def drawn_bench(
    seed: int, *, told: Mapping[str, Any] | None = None, more: Mapping[str, Mapping[str, Any]] | None = None
) -> BenchDescription:
    """Return the bench of a seed: its gyroscope and all instruments drawn, these not as the program draws them.

    Args:
        seed: of the draw.
        told: keys of [uncertainty] of its bench file that are changed.
        more: parameters of the gyroscope besides, by group.
    """
    draw = np.random.default_rng([20260723, seed])
    base = parse_bench(gyroscopes.drawn_bench(seed), f"gyroscope-{seed}")
    simulation = base.simulation
    assert simulation is not None  # noqa: S101 - as above
    errors = structs.replace(
        simulation.errors,
        multimeter=_meter(draw),
        v_vc_meter=_meter(draw),
        rate_source=_generator(draw),
        power=_supply(draw),
        oscilloscope=_oscilloscope(draw),
    )
    bench = structs.replace(
        base,
        simulation=structs.replace(simulation, errors=errors),
        uncertainty=structs.replace(base.uncertainty, **(told or {})),
    )
    return changed(bench, more or {})


def changed(bench: BenchDescription, more: Mapping[str, Mapping[str, Any]]) -> BenchDescription:
    """Return the bench with other parameters of its simulation, by group."""
    assert bench.simulation is not None  # noqa: S101 - drawn benches are simulated
    override = {**bench.simulation.override}
    for group, values in more.items():
        override[group] = {**override.get(group, {}), **values}
    return structs.replace(bench, simulation=structs.replace(bench.simulation, override=override))


def _meter(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of a 34401A; its noise is that of the data sheet."""
    gain, offset_v = METER_LIMITS
    return {
        "gain_error": gain / SIGMAS * float(draw.standard_normal()),
        "offset_v": offset_v / SIGMAS * float(draw.standard_normal()),
        "noise": 0.3,
        "noise_seed": int(draw.integers(2**31)),
    }


def _generator(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of a 33220A within 2 % and 4 mV, whose ranges break anywhere."""
    uppers = [*np.sort(np.exp(draw.uniform(math.log(0.03), math.log(9.0), int(draw.integers(2, 5))))).tolist(), 10.0]
    ranges = [
        {
            "upper_v": upper_v,
            "gain_error": 0.02 * float(draw.uniform(-1.0, 1.0)),
            "offset_error_v": 4e-3 * float(draw.uniform(-1.0, 1.0)),
        }
        for upper_v in uppers
    ]
    return {"ranges": ranges, "dac_bits": 14, "setting_digits": 4}


def _supply(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of an E3631A by the limits of its guide."""
    outputs = {}
    for name in ("p25v", "n25v"):
        gains, offsets_v = 0.5e-3 * draw.uniform(-1.0, 1.0, 2), (20e-3, 10e-3) * draw.uniform(-1.0, 1.0, 2)
        outputs[name] = {
            "programming_gain": float(gains[0]),
            "programming_offset_v": float(offsets_v[0]),
            "readback_gain": float(gains[1]),
            "readback_offset_v": float(offsets_v[1]),
            "current_readback_gain": 1.5e-3 * float(draw.uniform(-1.0, 1.0)),
            "current_readback_offset_a": 4e-3 * float(draw.uniform(-1.0, 1.0)),
        }
    return {**outputs, "quantised": True}


def _oscilloscope(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of a DSO7104B within 2 %, a tenth of a division, 100 ps and 25 ppm: one for all runs of a bench."""
    return {
        "gain_error": draw.uniform(-0.02, 0.02, 4).tolist(),
        "offset_error_div": draw.uniform(-0.1, 0.1, 4).tolist(),
        "skew_s": draw.uniform(-1e-10, 1e-10, 4).tolist(),
        "time_base_error": float(draw.uniform(-25e-6, 25e-6)),
        "noise_div": 0.02,
        "converter_bits": 8,
        "noise_seed": int(draw.integers(2**31)),
    }


def another_day(bench: BenchDescription) -> BenchDescription:
    """Return the bench with the same instruments, whose noise is another."""
    assert bench.simulation is not None  # noqa: S101 - as above
    errors = bench.simulation.errors
    noisy = {
        role: {**each, "noise_seed": each["noise_seed"] + 1}
        for role, each in structs.asdict(errors).items()
        if isinstance(each, dict) and "noise_seed" in each
    }
    simulation = structs.replace(bench.simulation, errors=structs.replace(errors, **noisy))
    return structs.replace(bench, simulation=simulation)


class Truth(NamedTuple):
    """What is true of a bench's gyroscope, of small signals at rest."""

    bias_v: float
    scale_factor: float
    k_vc: float

    @classmethod
    def of(cls, bench: BenchDescription) -> Truth:
        """Return it by the closed form of the warm gyroscope."""
        output, at_input = true_output(bench), true_output(bench, at_input=True)
        slope = (output(0.01, None) - output(-0.01, None)) / 0.02
        per_volt = (at_input(0.0, 1e-4) - at_input(0.0, -1e-4)) / 2e-4
        return cls(output(0.0, None), slope, per_volt / slope)


def run(procedure: str, bench: BenchDescription, seed: int, where: str, **settings: Any) -> Any:
    """Return the run of a procedure; ends the study where it gave no results."""
    done = vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=where)
    if done.results is None:
        raise SystemExit(f"{procedure}, seed {seed}: no results: {done.error}")
    return done


def zero(seed: int, where: str) -> Iterator[Stated]:
    """An hour at rest."""
    bench = drawn_bench(seed)
    true, noise = Truth.of(bench), physical_parameters(bench).noise
    found = run("zero", bench, seed, where, scale_factor_v_per_deg_s=true.scale_factor).results
    yield from stated("output_v", found.output_v, true.bias_v)
    yield from stated("bias", found.bias, true.bias_v / true.scale_factor)
    yield from stated("trend", found.trend, 0.0)
    truths = {
        "angle random walk": 60.0 * noise.angle_random_walk_deg_sqrt_s,
        "bias instability": 3600.0 * noise.bias_instability_deg_s,
    }
    for name, truth in truths.items():
        each = found.coefficient(name)
        if each.value and each.u:
            half = getattr(each, "u_95", None)
            yield Stated(name, each.value, truth, each.u, 1.96 * each.u if half is None else half)
        yield Stated(f"{name}, below", each.upper_95, truth)


def warmup(seed: int, where: str) -> Iterator[Stated]:
    """From power-on; every other gyroscope has an exponential that is seen."""
    bench = drawn_bench(seed)
    seen = {} if seed % 2 else {"thermal": {"self_heating_k": 3.0, "bias_coefficient_deg_s_k": 30.0 / 3600.0}}
    assert bench.simulation is not None  # noqa: S101 - as above
    override = {**bench.simulation.override, **seen}
    bench = structs.replace(bench, simulation=structs.replace(bench.simulation, override=override))
    true, of = Truth.of(bench), physical_parameters(bench)
    flicker_deg_h = 3600.0 * of.noise.bias_instability_deg_s
    settings = {"scale_factor_v_per_deg_s": true.scale_factor, "bias_instability_deg_h": flicker_deg_h}
    found = run("warmup", bench, seed, where, **settings).results
    kind = "seen" if found.amplitude is not None else "unseen"
    yield from stated(f"bias_end, exponential {kind}", found.bias_end, true.bias_v / true.scale_factor)
    if seen:
        yield from stated("time_constant", found.time_constant, of.thermal.time_constant_s)


def repeatability(seed: int, where: str) -> Iterator[Stated]:
    """Spreads of 5 to 50 mdeg/s and 20 to 200 ppm, noise in them, by their logarithms; a warm-up of 25 mdeg/s."""
    draw = np.random.default_rng([20261129, seed])
    of_bias, of_slope = (low * 10.0 ** float(draw.uniform()) for low in (5e-3, 2e-5))
    bench = drawn_bench(seed)
    simulation = bench.simulation
    assert simulation is not None  # noqa: S101 - as above
    spreads = {"switch_on_bias_deg_s": of_bias, "switch_on_scale_factor": of_slope}
    # Quadrature makes of 0.02 K, the simulation's usual step, more bias than there is noise in some
    thermal = {"self_heating_k": 3.0, "bias_coefficient_deg_s_k": 30.0 / 3600.0, "refresh_k": 1e-3}
    override = {**simulation.override, "noise": {**simulation.override["noise"], **spreads}, "thermal": thermal}
    bench = structs.replace(bench, simulation=structs.replace(simulation, override=override))
    told = {"scale_factor_v_per_deg_s": Truth.of(bench).scale_factor, "off_s": 7200.0}
    done = run("repeatability", bench, seed, where, **told)
    found, of = done.results, physical_parameters(bench).thermal
    for name, spread, own in (("bias", found.bias, of_bias), ("scale factor", found.scale_factor, 1e6 * of_slope)):
        low, high = math.log(spread.low), math.log(spread.high)
        half, truth = (high - low) / 2.0, math.log(math.hypot(own, spread.by_noise))
        yield Stated(f"ln spread of {name}", (high + low) / 2.0, truth, half / 1.96, half)
    # The gyroscope as warm as it was in the window after power-on and in the zeros of the block; all are alike
    lines = [json.loads(line) for line in (done.directory / "journal.jsonl").read_text("utf-8").splitlines()]
    steps = [line for line in lines if line.get("step_kind") in {"EnableSupply", "Acquire"}]
    rest = [line["result"]["readings"] for line in steps[1:7] if not line["point"]["rate_deg_s"]]

    def output_v(readings: list[dict[str, float]]) -> float:
        since_s = float(np.mean([each["t_s"] for each in readings])) - steps[0]["end_s"]
        warmed = {**thermal, "self_heating_k": of.self_heating_k * -math.expm1(-since_s / of.time_constant_s)}
        as_warm = structs.replace(simulation, override={**override, "thermal": warmed})
        return true_output(structs.replace(bench, simulation=as_warm))(0.0, None)

    early, *warm = map(output_v, rest)
    transient = (early - float(np.mean(warm))) / told["scale_factor_v_per_deg_s"]
    yield from stated("turn-on transient", found.turn_on_transient, transient)


def kvc(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc on the table."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    found = run("kvc", bench, seed, where, warm_up_s=1800.0).results
    yield from stated("bias", found.bias, true.bias_v)
    yield from stated("k_vc", found.k_vc, true.k_vc)
    yield from stated("scale_factor", found.scale_factor, true.scale_factor)


def kvc_as_set(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc on the table, V_Vc believed as it is set, the generator's ranges unknown."""
    bench = drawn_bench(seed, told={"generator_ranges_v": None})
    output = true_output(bench)
    slope = (output(0.01, None) - output(-0.01, None)) / 0.02
    per_volt = (output(0.0, 1e-4) - output(0.0, -1e-4)) / 2e-4
    found = run("kvc", bench, seed, where, warm_up_s=1800.0, v_vc="set").results
    yield from stated("k_vc", found.k_vc, per_volt / slope)


def self_calibration(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc on the table, then the gyroscope by itself, the noise another."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    settings = {"warm_up_s": 1800.0, "dut": "G", "devices": f"{where}/devices"}
    run("kvc", bench, 2 * seed, where, **settings)
    found = run("self-calibration", another_day(bench), 2 * seed + 1, where, **settings).results
    yield from stated("bias", found.bias, true.bias_v)
    yield from stated("scale_factor", found.scale_factor, true.scale_factor)
    yield from stated("drift", found.drift.change_ppm, 0.0)


def self_calibration_as_set(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc with V_Vc measured, then the gyroscope by itself, V_Vc believed as it is set, the ranges unknown."""
    bench = drawn_bench(seed, told={"generator_ranges_v": None})
    true = Truth.of(bench)
    settings = {"warm_up_s": 1800.0, "dut": "G", "devices": f"{where}/devices"}
    run("kvc", bench, 2 * seed, where, **settings)
    found = run("self-calibration", another_day(bench), 2 * seed + 1, where, v_vc="set", **settings).results
    yield from stated("bias", found.bias, true.bias_v)
    yield from stated("scale_factor", found.scale_factor, true.scale_factor)
    yield from stated("drift", found.drift.change_ppm, 0.0)


def characterize(seed: int, where: str) -> Iterator[Stated]:
    """The session whose later parts are warm: values of its parts, and biases as the data sheet has them."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    parts = ["warmup", "turntable", "kvc", "zero"]
    found = run("characterize", bench, seed, where, parts=parts).results
    line = turntable_truth(true_output(bench), bench.procedure.rates_deg_s)
    truths = {
        ("kvc", "bias", "V"): true.bias_v,
        ("zero", "bias", "deg/s"): true.bias_v / true.scale_factor,
        ("zero", "output", "V"): true.bias_v,
        ("warmup", "bias end", "deg/s"): true.bias_v / true.scale_factor,
        ("kvc", "K_Vc", "(deg/s)/V"): true.k_vc,
        ("kvc", "scale factor", "V/(deg/s)"): true.scale_factor,
        ("turntable", "scale factor", "V/(deg/s)"): line["scale_factor"],
        ("turntable", "bias", "V"): line["bias"],
        ("turntable", "bias", "deg/s"): line["bias_deg_s"],
    }
    for row in found.data_sheet:
        truth = truths.get((row.procedure, row.quantity, row.unit))
        if truth is not None and row.u:
            yield Stated(f"{row.procedure}: {row.quantity}, {row.unit}", row.value, truth, row.u, row.u95)


class Modes(NamedTuple):
    """The modes of a warm gyroscope: drive, anti-phase and in-phase sense mode, and what each shows of V_Vc."""

    drive_hz: float
    drive_q: float
    sense_hz: tuple[float, float]
    sense_q: tuple[float, float]
    shown: tuple[float, float]
    shown_of_rate: tuple[float, float]
    carrier_rad: float
    demodulator_rad: float
    low_pass: tuple[float, int]

    @classmethod
    def of(cls, bench: BenchDescription, ambient_c: float | None = None) -> Modes:
        """Return those of the parameters at the temperature after the warm-up."""
        of = physical_parameters(bench)
        ambient_c = of.thermal.ambient_c if ambient_c is None else ambient_c
        rise_k = ambient_c + of.thermal.self_heating_k - of.thermal.reference_c
        sense, virtual = (of.sense_anti_phase, of.sense_in_phase), of.virtual_path
        drive, *hz = (
            each.frequency_hz * (1.0 + each.frequency_coefficient_per_k * rise_k) for each in (of.drive_mode, *sense)
        )
        drive_q, *q = (
            each.quality * (1.0 + each.quality_coefficient_per_k * rise_k) for each in (of.drive_mode, *sense)
        )
        combs = [
            each.left_participation * virtual.left_comb_n_per_v2
            + each.right_participation * virtual.right_comb_n_per_v2
            for each in sense
        ]
        shares = [each.left_participation + each.right_participation for each in sense]
        picks = [each.pick_off_v_per_m for each in sense]
        return cls(
            drive,
            drive_q,
            (hz[0], hz[1]),
            (q[0], q[1]),
            (picks[0] * combs[0], picks[1] * combs[1]),
            (picks[0] * shares[0], picks[1] * shares[1]),
            virtual.carrier_phase_rad,
            of.sense_path.demodulator_phase_rad,
            (of.sense_path.low_pass_hz, of.sense_path.low_pass_order),
        )

    @property
    def split_hz(self) -> float:
        """Drive less anti-phase sense frequency."""
        return self.drive_hz - self.sense_hz[0]

    @property
    def in_phase_share(self) -> float:
        """Part of the in-phase mode in the static response to V_Vc, each mode by its stiffness."""
        anti, inner = (k / (hz**2 - self.drive_hz**2) for k, hz in zip(self.shown, self.sense_hz, strict=True))
        return inner / (anti + inner)

    def answer(self, shown: tuple[float, float], side_hz: float) -> complex:
        """Return the sense signal of a unit force at a frequency, any unit."""
        modes = zip(shown, self.sense_hz, self.sense_q, strict=True)
        return sum(k / complex(hz**2 - side_hz**2, side_hz * hz / q) for k, hz, q in modes)

    def gain(self, frequency_hz: float) -> float:
        """Return the response to a sine on V_Vc over that to a level, without the filter: both side bands."""
        turn = cmath.exp(1j * (self.carrier_rad - self.demodulator_rad))

        def passed(at_hz: float) -> complex:
            above, below = (self.answer(self.shown, self.drive_hz + each) for each in (at_hz, -at_hz))
            return above * turn + (below * turn).conjugate()

        return abs(passed(frequency_hz) / passed(0.0))

    def filtered(self, frequency_hz: float) -> float:
        """Return the same behind the low-pass filter."""
        corner_hz, order = self.low_pass
        return self.gain(frequency_hz) / math.sqrt(1.0 + (frequency_hz / corner_hz) ** (2 * order))

    def noise(self, per_sqrt_hz: float) -> float:
        """Return the standard deviation of the output by white noise of the force, both sides of the drive, as a rate.

        Nearly all of that of a narrow mode is at the split, where a reading shows nothing of it.
        """
        narrow_hz, (corner_hz, order) = self.sense_hz[0] / (2.0 * self.sense_q[0]), self.low_pass
        beside_hz = narrow_hz * np.sinh(np.linspace(0.0, math.asinh(20.0 * abs(self.split_hz) / narrow_hz), 400))
        hz = self.split_hz + np.concatenate([-beside_hz[:0:-1], beside_hz])
        still = abs(self.answer(self.shown_of_rate, self.drive_hz))
        passed = [abs(self.answer(self.shown_of_rate, self.drive_hz - each)) / still for each in hz.tolist()]
        squares = np.square(passed) / (1.0 + (hz / corner_hz) ** (2 * order))
        return per_sqrt_hz * math.sqrt(float(np.sum((squares[1:] + squares[:-1]) * np.diff(hz))) / 2.0)

    def peak_hz(self) -> float:
        """Return where the response is largest, to a millihertz or better."""
        low, high = 0.8 * abs(self.split_hz), 1.2 * abs(self.split_hz)
        for _ in range(80):
            inner = low + (high - low) / 3.0, high - (high - low) / 3.0
            low, high = (inner[0], high) if self.gain(inner[0]) < self.gain(inner[1]) else (low, inner[1])
        return 0.5 * (low + high)

    def crossing_hz(self, level: float, low_hz: float, high_hz: float) -> float:
        """Return where the response passes a level between two frequencies."""
        rising = self.gain(high_hz) > self.gain(low_hz)
        for _ in range(80):
            middle = 0.5 * (low_hz + high_hz)
            low_hz, high_hz = (low_hz, middle) if (self.gain(middle) > level) == rising else (middle, high_hz)
        return 0.5 * (low_hz + high_hz)


def bandwidth(seed: int, where: str) -> Iterator[Stated]:
    """The response to sines on V_Vc."""
    bench = drawn_bench(seed)
    found = run("bandwidth", bench, seed, where).results
    yield from _band(found, Modes.of(bench))


def _band(found: Any, true: Modes) -> Iterator[Stated]:
    peak_hz = true.peak_hz()
    yield from stated("split_hz", found.split_hz, as_told(found.split_hz, true.split_hz))
    yield from stated("q", found.q, true.sense_q[0])
    yield from stated("plus_3_db_hz", found.plus_3_db_hz, true.crossing_hz(math.sqrt(2.0), 0.0, peak_hz))
    yield from stated("peak_hz", found.peak_hz, peak_hz)
    yield from stated("peak_gain", found.peak_gain, true.gain(peak_hz))
    steps_hz = peak_hz * np.arange(1.05, 6.0, 0.05)  # the other mode may raise the gain again
    below_hz = next(float(hz) for hz in steps_hz if true.gain(float(hz)) < math.sqrt(0.5))
    yield from stated("minus_3_db_hz", found.minus_3_db_hz, true.crossing_hz(math.sqrt(0.5), peak_hz, below_hz))
    share, u = found.in_phase_share, found.u_in_phase_share
    yield Stated("in_phase_share", share, true.in_phase_share, u, 1.96 * u)


def resonance(seed: int, where: str) -> Iterator[Stated]:
    """Ring-downs and sweep."""
    bench = drawn_bench(seed)
    found, true = run("resonance", bench, seed, where).results, Modes.of(bench)
    truths = {
        "drive_hz": true.drive_hz,
        "drive_ring_down_hz": true.drive_hz,
        "drive_q": true.drive_q,
        "sense_hz": true.sense_hz[0],
        "sense_q_ring_down": true.sense_q[0],
        "sense_q_sweep": true.sense_q[0],
        "split_ring_down_hz": true.split_hz,
        "split_sweep_hz": true.split_hz,
        "in_phase_hz": true.sense_hz[1],
        "in_phase_q": true.sense_q[1],
    }
    for name, truth in truths.items():
        each = getattr(found, name)
        yield from stated(name, each, as_told(each, truth) if name.startswith("split") else truth)
    e_n = max(found.e_n_drive_hz or 0.0, found.e_n_sense_q, found.e_n_split)
    yield Stated("largest E_n of the two ways, below 1", 1.0, e_n)


def phase(seed: int, where: str) -> Iterator[Stated]:
    """The phases, of a carrier and a demodulator that are up to 3 deg off."""
    draw = np.random.default_rng([20260724, seed])
    carrier, demodulator = (math.pi + math.radians(each) for each in draw.uniform(-3.0, 3.0, 2))
    more = {"virtual_path": {"carrier_phase_rad": carrier}, "sense_path": {"demodulator_phase_rad": demodulator}}
    bench = drawn_bench(seed, more=more)
    found, true = run("phase", bench, seed, where).results, Modes.of(bench)
    coriolis = math.degrees(cmath.phase(true.answer(true.shown_of_rate, true.drive_hz))) - 90.0
    virtual = math.degrees(cmath.phase(true.answer(true.shown, true.drive_hz)) + carrier) + 90.0
    reference = math.degrees(demodulator) + 90.0
    seen, aside = (math.cos(math.radians(each - reference)) for each in (virtual, coriolis))
    truths = {
        "carrier_deg": math.degrees(carrier) + 90.0,
        "coriolis_deg": coriolis,
        "virtual_deg": virtual,
        "demodulator_deg": reference,
        "k_vc_error_ppm": 1e6 * (abs(seen / aside) - 1.0),
        "carrier_from_velocity_deg": math.remainder(math.degrees(carrier), 180.0),
        "virtual_from_coriolis_deg": math.remainder(virtual - coriolis, 180.0),
        "demodulator_from_coriolis_deg": math.remainder(reference - coriolis, 180.0),
    }
    for name, truth in truths.items():
        each = getattr(found, name)
        turned = 180.0 if name == "demodulator_deg" else 360.0
        near = truth if "ppm" in name else each.value - math.remainder(each.value - truth, turned)
        yield from stated(name, each, near)


def vibration(seed: int, where: str) -> Iterator[Stated]:
    """A sine of the second generator; what is told of split, Q and in-phase mode is off by its u."""
    bench = drawn_bench(seed)
    true, draw = Modes.of(bench), np.random.default_rng([20260725, seed])
    told = {"split_hz": (true.split_hz, 1e-3 * abs(true.split_hz)), "q": (true.sense_q[0], 0.01 * true.sense_q[0])}
    told["in_phase_share"] = (true.in_phase_share, 0.01)
    settings = {name: value + u * float(draw.standard_normal()) for name, (value, u) in told.items()}
    settings |= {f"u_{name}": u for name, (_, u) in told.items()}
    done = run("vibration", bench, seed, where, **settings)
    found, (at_rest, responses) = done.results, vibration_truth(bench, done)
    yield from stated("static_v_per_v", found.static_v_per_v, at_rest)
    for place, (each, truth) in enumerate(zip(found.responses, responses, strict=True)):
        yield from stated(f"response at {place}", each.response, truth)
        yield from stated(f"expected at {place}", each.expected, true.filtered(each.frequency_hz))
    yield Stated("largest_e_n, below 1", 1.0, found.largest_e_n)


def vibration_truth(bench: BenchDescription, run: Run) -> tuple[float, list[float]]:
    """Return the response at rest, V/V, and those to the vibrations, between the levels at which V_Vc really was.

    Generators have offsets, and a bent modulator has a slope of its own about each.
    """
    modes, output = Modes.of(bench), true_output(bench, at_input=True)
    levels = [(math.copysign(1.0, point.v_vc_v), point.v_vc_measured_v or point.v_vc_v) for point in run.points]
    at_rest = sum(s * output(0.0, v) for s, v in levels) / sum(s * v for s, v in levels)
    responses = []
    for each, (_, record) in zip(run.results.responses, run.measured.found(steps.ModulatedRecord), strict=True):
        level_v, half_v = fmean(record.v_vc_v), 0.75**0.5 * each.v_vc_amplitude_v
        slope = (output(0.0, level_v + half_v) - output(0.0, level_v - half_v)) / (2.0 * half_v)
        responses.append(modes.filtered(each.frequency_hz) * slope / at_rest)
    return at_rest, responses


def temperature(seed: int, where: str) -> Iterator[Stated]:
    """The cycle over temperature, with V_Vc."""
    yield from _over_temperature(seed, where, "v-vc")


def temperature_by_table(seed: int, where: str) -> Iterator[Stated]:
    """The cycle over temperature, with the table."""
    yield from _over_temperature(seed, where, "table")


def _over_temperature(seed: int, where: str, by: str) -> Iterator[Stated]:
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    settings = {"by": by, "scale_factor_v_per_deg_s": true.scale_factor}
    flicker_deg_h = 3600.0 * physical_parameters(bench).noise.bias_instability_deg_s
    done = run("temperature", bench, seed, where, **settings, bias_instability_deg_h=flicker_deg_h)
    found = done.results
    levels, level_deg_s = done.header["settings"]["temperatures_c"], done.header["settings"]["level_deg_s"]
    level_v = level_deg_s / done.header["settings"]["k_vc_guess_deg_s_per_v"]
    slopes, biases, drives = [], [], []
    for each_c in levels:
        output = true_output(at_ambient(bench, each_c))
        plus_minus = (level_deg_s, None, 2.0 * level_deg_s) if by == "table" else (0.0, level_v, 2.0 * level_v)
        signs = [output(sign * plus_minus[0], None if by == "table" else sign * level_v) for sign in (1.0, -1.0)]
        slopes.append((signs[0] - signs[1]) / plus_minus[2])
        biases.append(output(0.0, None) / true.scale_factor if by != "table" else output(0.0, None))
        drives.append(Modes.of(bench, each_c).drive_hz)
    if by == "table":
        biases = [each / slope for each, slope in zip(biases, slopes, strict=True)]

    def parabola(values: Sequence[float]) -> list[float]:
        return np.polynomial.polynomial.polyfit(np.array(levels) - 20.0, values, 2).tolist()  # type: ignore[no-any-return]

    factor, bias, drive = parabola(slopes), parabola(biases), parabola(drives)
    ppm, ppm_hz = 1e6 / factor[0], 1e6 / drive[0]
    yield from stated("scale_factor", found.scale_factor, factor[0])
    yield from stated("scale_factor_tc", found.scale_factor_tc, ppm * factor[1])
    yield from stated("scale_factor_tc2", found.scale_factor_tc2, ppm * factor[2])
    yield from stated("scale_factor_hysteresis", found.scale_factor_hysteresis, 0.0)
    yield from stated("bias", found.bias, bias[0])
    yield from stated("bias_tc", found.bias_tc, bias[1])
    yield from stated("bias_hysteresis", found.bias_hysteresis, 0.0)
    yield from stated("frequency", found.frequency, drive[0])
    yield from stated("frequency_tc", found.frequency_tc, ppm_hz * drive[1])
    yield from stated("frequency_hysteresis", found.frequency_hysteresis, 0.0)


def at_ambient(bench: BenchDescription, ambient_c: float) -> BenchDescription:
    """Return a bench in air of another temperature."""
    return changed(bench, {"thermal": {"ambient_c": ambient_c}})


def power(seed: int, where: str) -> Iterator[Stated]:
    """Sensitivities to the rails of a gyroscope whose drive follows the weaker one, by up to 0.5 % a volt."""
    draw = np.random.default_rng([20260726, seed])
    coefficient = 5e-3 * float(draw.uniform(-1.0, 1.0))
    bench = drawn_bench(seed, more={"drive_loop": {"amplitude_supply_coefficient_per_v": coefficient}})
    true = Truth.of(bench)
    done = run("power", bench, seed, where, scale_factor_v_per_deg_s=true.scale_factor)
    found, asked = done.results, done.header["settings"]
    step_v, rail_v = asked["rail_step_v"], asked["positive_rail_v"]
    level_v = asked["level_deg_s"] / asked["k_vc_guess_deg_s_per_v"]

    def at(rails: str, off_v: float) -> tuple[float, float]:
        positive, negative = (off_v if rails in {each, "both"} else 0.0 for each in ("positive", "negative"))
        output = true_output(bench, rails_v=(rail_v + positive, -rail_v - negative))
        return (output(0.0, level_v) - output(0.0, -level_v)) / (2.0 * level_v), output(0.0, None) / true.scale_factor

    for effect in found.effects:
        low, here, high = (at(effect.rails, off_v) for off_v in (-step_v, 0.0, step_v))
        halves = {"lowered": (low, here, step_v), "raised": (here, high, step_v), "": (low, high, 2.0 * step_v)}
        for half, (first, second, apart_v) in halves.items():
            name = f"_{half}" if half else ""
            factor = 1e6 * (second[0] / here[0] - first[0] / here[0]) / apart_v
            yield from stated(f"{effect.rails}: scale_factor{name}", getattr(effect, f"scale_factor{name}"), factor)
            bias = (second[1] - first[1]) / apart_v
            yield from stated(f"{effect.rails}: bias{name}", getattr(effect, f"bias{name}"), bias)
    quiescent_a = physical_parameters(bench).supply.quiescent_a
    for rail in found.rails:
        yield from stated(f"current, {rail.rail}", rail.current, quiescent_a)
    yield from stated("power", found.power, 2.0 * rail_v * quiescent_a)


def rate_limits(seed: int, where: str) -> Iterator[Stated]:
    """Input rate limits by V_Vc, of an output that clips between 4.5 and 8.5 V."""
    draw = np.random.default_rng([20261128, seed])
    rail_v = gyroscopes.drawn_sheet(seed).rail_v
    bench = drawn_bench(seed, more={"output_stage": {"headroom_v": float(draw.uniform(0.15, 0.3)) * rail_v}})
    yield from _rate_limits(seed, where, bench, draw, by="v-vc")


def rate_limits_by_table(seed: int, where: str) -> Iterator[Stated]:
    """Input rate limits by the table: every other output clips within its rates, the others bend, by the cube."""
    draw = np.random.default_rng([20261129, seed])
    sheet, clips, bends = gyroscopes.drawn_sheet(seed), float(draw.uniform(0.8, 1.3)), float(draw.uniform(1.0, 3.0))
    whole_v = abs(sheet.scale_factor_v_per_deg_s) * sheet.range_deg_s
    bent = {"third_order_per_v2": -1e-2 * bends / whole_v**2}
    stage = bent if seed % 2 else {"headroom_v": max(0.15 * sheet.rail_v, sheet.rail_v - clips * whole_v)}
    bench = drawn_bench(seed, more={"output_stage": stage})
    yield from _rate_limits(seed, where, bench, draw, by="table")


def _rate_limits(
    seed: int, where: str, bench: BenchDescription, draw: np.random.Generator, *, by: str
) -> Iterator[Stated]:
    assert bench.simulation is not None  # noqa: S101 - as above
    errors: Any = bench.simulation.errors.power
    asked_v = round(bench.procedure.positive_rail_v / 1.5e-3) * 1.5e-3  # in steps of an E3631A (p. 186)
    of_each = [(errors[name]["programming_gain"], errors[name]["programming_offset_v"]) for name in ("p25v", "n25v")]
    rails = [asked_v * (1.0 + gain) + offset_v for gain, offset_v in of_each]
    output = true_output(bench, rails_v=(rails[0], -rails[1]), at_input=True)
    slope = (output(0.01, None) - output(-0.01, None)) / 0.02
    told = {"scale_factor_v_per_deg_s": slope * (1.0 + 100e-6 * float(draw.standard_normal()))}
    told["scale_factor_u_v_per_deg_s"] = 100e-6 * abs(slope)
    done = run("rate-limits", bench, seed, where, by=by, **told)
    found, level_deg_s = done.results, done.header["settings"]["level_deg_s"]
    small, most = level_deg_s, bench.limits.max_rate_deg_s or 0.0
    if by != "table":
        small, most = level_deg_s / abs(bench.procedure.k_vc_guess_deg_s_per_v), 11.0  # more than generators reach

    of_noise_deg_s = Modes.of(bench).noise(physical_parameters(bench).noise.angle_random_walk_deg_sqrt_s)
    spots, weights = np.polynomial.hermite_e.hermegauss(60)

    def at(x: float) -> float:  # the mean of what clips the gyroscope's own noise before it clips the rate
        rates, v_vc_v = (x, None) if by == "table" else (0.0, x)
        rates = (rates + of_noise_deg_s * spots).tolist()
        return float(weights @ [output(each, v_vc_v) for each in rates] / weights.sum())

    zero_v, per_input = at(0.0), (at(small) - at(-small)) / (2.0 * small)
    turned = 1.0 if by == "table" else math.copysign(1.0, per_input / slope)
    for name, rate_sign in (("positive", 1.0), ("negative", -1.0)):
        low, high, sign = small, most, rate_sign * turned
        for _ in range(80):
            middle = 0.5 * (low + high)
            lacks = 1.0 - (at(sign * middle) - zero_v) / (per_input * sign * middle)
            low, high = (low, middle) if lacks > 0.01 else (middle, high)
        each, truth = getattr(found, name), sign * low * (1.0 if by == "table" else per_input / slope)
        if each.limit is None:
            yield Stated(f"{name} bound, below the limit", abs(truth), abs(each.at_least_deg_s))
            continue
        yield from stated(f"{name} limit", each.limit, truth)
        yield from stated(f"output after minus before overrange, {name}", each.comes_back, 0.0)
        if at(sign * 1.04 * low) == at(sign * 1.1 * low):  # one that bends has another output at each rate beyond
            yield from stated(f"output beyond, {name}", each.clipped, at(sign * 1.1 * low))


def turntable(seed: int, where: str) -> Iterator[Stated]:
    """The paper's rates on the table: scale factor of the line, and its asymmetry."""
    bench = drawn_bench(seed)
    output, rates = true_output(bench), np.array(bench.procedure.rates_deg_s)
    volts = np.array([output(rate, None) for rate in rates])
    slope = float(np.polyfit(rates, volts, 1)[0])
    up, down = (float(np.polyfit(rates[side], volts[side], 1)[0]) for side in (rates >= 0.0, rates <= 0.0))
    found = run("turntable", bench, seed, where).results.uncertainty
    yield from stated("scale_factor", found.value("scale_factor"), slope)
    yield from stated("asymmetry", found.value("asymmetry"), 2e6 * (up - down) / (up + down))


def electrical(seed: int, where: str) -> Iterator[Stated]:
    """Resistances of the lines, PCB, meter and leads drawn: the meter within its limits, leads up to 0.2 ohm."""
    draw = np.random.default_rng([20261130, seed])
    rails, output, pull_down = (float(size * draw.uniform(0.6, 1.6)) for size in (1000.0, 100.0, 1e6))
    more = {
        "supply": {"input_ohm": rails},
        "source": {"output_ohm": output},
        "virtual_path": {"pull_down_ohm": pull_down},
    }
    bench = drawn_bench(seed, more=more)
    simulation = bench.simulation
    assert simulation is not None  # noqa: S101 - as above
    ohms = {f"{name}_share": float(draw.standard_normal()) / SIGMAS for name in ("reading", "range")}
    ohms["lead_ohm"] = float(draw.uniform(0.0, 0.2))
    meter: Any = simulation.errors.multimeter
    errors = structs.replace(simulation.errors, multimeter={**meter, "ohms": ohms})
    bench = structs.replace(bench, simulation=structs.replace(simulation, errors=errors))
    wide = {"output_ohm": [10.0, 1000.0], "v_vc_ohm": [1e5, 1e7]}
    found = run("electrical", bench, seed, where, **wide).results
    truths = {"rail_positive": rails, "rail_negative": rails, "v_vc": pull_down, "output": output}
    for each in found.lines:
        yield from stated(each.of, each.resistance, truths[each.of])


def threshold(seed: int, where: str) -> Iterator[Stated]:
    """Dead bands of up to 0.3 deg/s and down to what noise hides, by V_Vc; K_Vc is told and off by its u."""
    yield from _threshold(seed, where, {})


def threshold_by_table(seed: int, where: str) -> Iterator[Stated]:
    """The same by the table."""
    smallest_deg_s = min(tomllib.loads(gyroscopes.drawn_bench(seed))["procedure"]["threshold"]["steps_deg_s"])
    yield from _threshold(seed, where, {"by": "table", "rate_tolerance_deg_s": min(0.01, smallest_deg_s)})


def _threshold(seed: int, where: str, settings: Mapping[str, Any]) -> Iterator[Stated]:
    draw, sheet = np.random.default_rng([20260727, seed]), gyroscopes.drawn_sheet(seed)
    u_k_vc = 7e-4 * abs(sheet.k_vc_deg_s_per_v)
    half_deg_s = sheet.range_deg_s * math.exp(float(draw.uniform(math.log(1.5e-6), math.log(1.5e-3))))
    told_k_vc = Truth.of(drawn_bench(seed)).k_vc + u_k_vc * float(draw.standard_normal())
    bench = drawn_bench(seed, more={"sense_path": {"dead_band_deg_s": half_deg_s}, "pick_up": {"v_vc_lead_v": 0.0}})
    known = {"k_vc_deg_s_per_v": told_k_vc, "k_vc_u_deg_s_per_v": u_k_vc}
    found = run("threshold", bench, seed, where, **known, **settings).results
    truths = {"dead_band": half_deg_s, "threshold": 2.0 * half_deg_s, "resolution": 0.0}
    for name, truth in truths.items():
        limit = getattr(found, name)
        yield from stated(name, limit.deg_s, truth)
        if truth:  # what is at most so much is always more than none
            yield Stated(f"{name}, below", limit.at_most_deg_s, truth)


def g_sensitivity(seed: int, where: str) -> Iterator[Stated]:
    """Sensitivities of some 0.05 (deg/s)/g, each position up to a degree askew either way; its heading is right."""
    draw, limit = np.random.default_rng([20260728, seed]), math.radians(1.0)
    per_g = 0.05 * draw.standard_normal(3)
    bench = drawn_bench(seed, more={"sense_path": {"g_sensitivity_deg_s_g": per_g.tolist()}})
    askew = {}
    for name, up in world.UP_AXES.items():
        leaning = np.where(np.array(up) == 0.0, draw.uniform(-limit, limit, 3), up)
        askew[name] = tuple((leaning / np.linalg.norm(leaning)).tolist())
    told = {"scale_factor_v_per_deg_s": Truth.of(bench).scale_factor, "scale_factor_u_v_per_deg_s": 0.0}
    with patch.dict(world.UP_AXES, askew):
        found = run("g-sensitivity", bench, seed, where, **told, heading_deg=0.0).results
    for axis, truth in zip("xyz", per_g.tolist(), strict=True):
        yield from stated(f"{axis} axis", found.per_g[axis], truth)


STUDIES: Mapping[str, Callable[[int, str], Iterator[Stated]]] = {
    "zero": zero,
    "warmup": warmup,
    "repeatability": repeatability,
    "kvc": kvc,
    "kvc-as-set": kvc_as_set,
    "self-calibration": self_calibration,
    "self-calibration-as-set": self_calibration_as_set,
    "characterize": characterize,
    "bandwidth": bandwidth,
    "resonance": resonance,
    "phase": phase,
    "vibration": vibration,
    "temperature": temperature,
    "temperature-by-table": temperature_by_table,
    "power": power,
    "turntable": turntable,
    "electrical": electrical,
    "rate-limits": rate_limits,
    "rate-limits-by-table": rate_limits_by_table,
    "threshold": threshold,
    "threshold-by-table": threshold_by_table,
    "g-sensitivity": g_sensitivity,
}


def line_of(procedure: str, seed: int) -> Line:
    """Return the line of a seed: procedure, seed, of each value [value, truth, u, u95], or why it is refused."""
    line: Line = {"procedure": procedure, "seed": seed, "values": {}}
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as where:
        try:
            line["values"] = {each.name: list(each[1:]) for each in STUDIES[procedure](seed, where)}
        except MeasurementError as error:
            line["refused"] = str(error)
    return line


def lines_of(files: Iterable[Path]) -> list[Line]:
    """Return the lines of some files; one that was cut off at the end of a file is left out."""
    texts = [text for file in files for text in file.read_text(encoding="utf-8").splitlines(keepends=True)]
    return [json.loads(text) for text in texts if text.endswith("\n")]


def continued(file: Path | None, procedure: str, seeds: Sequence[int]) -> list[Line]:
    """Return the lines of `seeds`: those that stand in `file`, and those that are run now and added to it."""
    had = lines_of([file]) if file is not None and file.exists() else []
    known = {line["seed"]: line for line in had if line["procedure"] == procedure}
    if file is not None:
        file.write_text("".join(json.dumps(line) + "\n" for line in had), encoding="utf-8")
    for seed in seeds:
        if seed in known:
            continue
        known[seed] = line_of(procedure, seed)
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                print(json.dumps(known[seed]), file=out)
    return [known[seed] for seed in seeds]


def summary(lines: Sequence[Line]) -> Iterator[str]:
    """Yield the table of the study, a row a value; what is beyond the limits ends with a star and why."""
    yield f"{'value':58} {'seeds':>5} {'mean z':>7} {'rms z':>6} {'max |z|':>7} {'in U95':>7}"
    for procedure in dict.fromkeys(line["procedure"] for line in lines):
        yield from (
            f"seed {x['seed']} refused: {x['refused']}" for x in lines if "refused" in x and x["procedure"] == procedure
        )
        own = [line["values"] for line in lines if line["procedure"] == procedure]
        for name in sorted({each for values in own for each in values}):
            yield _row(f"{procedure}: {name}", np.array([v[name] for v in own if name in v], dtype=np.float64))


def _row(name: str, found: Any) -> str:
    """Return the row of a value; found (n, 4): value, truth, u, u95, the last two NaN of a bound."""
    value, truth, u, u95 = found.T
    if np.isnan(u).all():
        held = truth <= value
        return f"{name:58} {value.size:5d} {'':7} {'':6} {'':7} {100.0 * held.mean():6.1f}%{_marked(held)}"
    z = (value - truth) / u
    if np.isnan(u95).any():
        return f"{name:58} {z.size:5d} {z.mean():+7.2f} {np.sqrt((z**2).mean()):6.2f} {abs(z).max():7.2f}  no U95"
    held = np.abs(value - truth) <= u95
    rms, share = np.sqrt((z**2).mean()), 100.0 * held.mean()
    mark = _marked(held, scores(found))
    return f"{name:58} {z.size:5d} {z.mean():+7.2f} {rms:6.2f} {abs(z).max():7.2f} {share:6.1f}%{mark}"


def _marked(held: Any, z: Any = ()) -> str:
    beyond = outside(held.tolist(), list(z))
    return f"{BEYOND}{beyond}" if beyond else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("procedure", nargs="?", choices=sorted(STUDIES))
    parser.add_argument("seeds", nargs="?", default="0:20", help="first, and the one after the last: 0:200")
    parser.add_argument("--lines", type=Path, help="file that keeps a line a seed")
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE", help="run nothing, sum up such files")
    asked = parser.parse_args()
    if asked.summary:
        lines = lines_of(asked.summary)
    elif asked.procedure:
        first, after = map(int, asked.seeds.split(":"))
        lines = continued(asked.lines, asked.procedure, range(first, after))
    else:
        parser.print_help()
        return 0
    rows = list(summary(lines))
    print("\n".join(rows))
    return int(any(BEYOND in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
