"""Each imperfection of the simulated bench alone: how large what a calibration sees of it is, and how large it must be.

    python experiments/imperfections.py

The bench is `ideal` with one thing switched on; what is seen comes from the instruments' readings. What is predicted is
written here from docs/theory.md: two modes, P = w_i^2 - w_d^2, R = w_i w_d / Q; nothing of the package computes it.
The exit code is 1 where one of them is not as predicted.
"""

from __future__ import annotations

import cmath
import math
import os
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from msgspec import structs

import vcfbench
from vcfbench.sim.gyro.design import ideal_bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

IDEAL = vcfbench.load_bench("ideal")
assert IDEAL.simulation is not None  # noqa: S101 - its file has one
SIMULATION = IDEAL.simulation
GYRO = ideal_bench()
K, K_VC = -12.542052e-3, 150.0
"""What `ideal` was made for: V/(deg/s), (deg/s)/V."""
SXX, S4 = 106_060.0, 2.0 * (200**4 + 100**4 + 50**4 + 20**4 + 10**4 + 5**4 + 2**4 + 1.0)
"""Sums of the squares and fourth powers of the paper's rates."""
EARTH_DEG_S = 15.041067 / 3600.0
MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile


@dataclass(frozen=True, slots=True)
class Case:
    """One imperfection, one thing that it does, and how large that must be."""

    name: str
    what: str
    predicted: float
    tolerance: float
    unit: str
    seen: Callable[[Any, Any], float]
    """Of the run with it and the run without."""
    override: Mapping[str, Any] = field(default_factory=dict)
    errors: Mapping[str, Any] = field(default_factory=dict)
    against: Mapping[str, Any] | None = field(default_factory=dict)
    """What is on in the run without it as well; None where nothing is compared with one."""
    procedure: str = "virtual-coriolis"
    settings: Mapping[str, Any] = field(default_factory=dict)


def modes(**changed: float) -> tuple[complex, ...]:
    """Return P + jR of both modes; `frequency` and `quality` of the anti-phase mode, or both, times 1 + x."""
    drive = 2.0 * math.pi * 3488.9
    found = []
    for name, frequency_hz in (("in", 3342.0), ("anti", 3464.1)):
        own = 2.0 * math.pi * frequency_hz * (1.0 + changed.get(f"{name}_frequency", 0.0))
        quality = 1224.0 * (1.0 + changed.get(f"{name}_quality", 0.0))
        found.append(complex(own**2 - drive**2, own * drive / quality))
    return tuple(found)


def gain(*answers: complex, phase_deg: float = 0.0, shares: tuple[float, float] = (1.0, 1.0)) -> float:
    """Return the demodulated answer of both modes to forces in phase with the reference but for `phase_deg`."""
    turned = cmath.exp(1j * math.radians(phase_deg))
    return sum(share * (turned / answer).real for share, answer in zip(shares, answers, strict=True))


def noise_bandwidth_hz(aperture_s: float) -> float:
    """Return the noise bandwidth of readings: what forces of both side bands, each by itself, make of it."""
    f = np.linspace(0.0, 200.0, 400_001)
    drive = 2.0 * math.pi * 3488.9
    at = np.stack([drive + 2.0 * math.pi * f, drive - 2.0 * math.pi * f])
    owns = [2.0 * math.pi * own_hz for own_hz in (3342.0, 3464.1)]
    bands = np.sum([1.0 / (own**2 - at**2 + 1j * own * at / 1224.0) for own in owns], axis=0)
    power = 0.5 * (np.abs(bands) ** 2).sum(axis=0) / bands[0, 0].real ** 2 * np.sinc(f * aperture_s) ** 2
    return float(np.trapezoid(power, f))


def rate_answer(f: Any) -> Any:
    """Return how much more the demodulated modes answer to a rate that swings at `f`, Hz, than to a steady one."""
    drive, turned = 2.0 * math.pi * 3488.9, 2.0 * math.pi * f
    owns = [2.0 * math.pi * own_hz for own_hz in (3342.0, 3464.1)]

    def answered(at: Any) -> Any:
        return sum(1.0 / (own**2 - at**2 + 1j * own * at / 1224.0) for own in owns)

    return np.abs(answered(drive + turned) + answered(drive - turned).conj()) / abs(2.0 * answered(drive).real)


def slope_ppm(run: Any, ideal: Any) -> float:
    """Return how far the table's scale factor is from that of the ideal bench."""
    return float(1e6 * (run.results.turntable.scale_factor.value / ideal.results.turntable.scale_factor.value - 1.0))


def k_vc_ppm(run: Any, ideal: Any) -> float:
    """Return how far K_Vc is from that of the ideal bench."""
    return float(1e6 * (run.results.k_vc.value / ideal.results.k_vc.value - 1.0))


def difference_ppm(run: Any, _ideal: Any) -> float:
    """Return how far the virtual scale factor is from the table's."""
    return float(1e4 * run.results.scale_factor_error_percent)


def bias_uv(run: Any, ideal: Any) -> float:
    """Return how far the table's bias is from that of the ideal bench."""
    return float(1e6 * (run.results.turntable.bias.value - ideal.results.turntable.bias.value))


def bias_difference_uv(run: Any, _ideal: Any) -> float:
    """Return how far the virtual bias is from the table's."""
    return float(1e6 * run.results.comparison.bias_difference_v)


def turned(part: str, **values: Any) -> dict[str, Any]:
    """Return an override of one group."""
    return {part: values}


def ranges(*gains_and_offsets: tuple[float, float, float]) -> dict[str, Any]:
    """Return errors of a generator: upper end of each range (V), its gain error, its offset (V)."""
    made = [{"upper_v": upper, "gain_error": g, "offset_error_v": o} for upper, g, o in gains_and_offsets]
    return {"rate_source": {"ranges": made}}


def meter(**errors: float) -> dict[str, Any]:
    """Return errors of the multimeter."""
    return {"multimeter": errors}


def cases() -> Iterator[Case]:
    """Yield all."""
    none = modes()
    base = gain(*none)
    yield Case("nothing", "virtual against table", 0.0, 1.0, "ppm", difference_ppm)
    yield from of_instruments()
    yield from of_the_modulator()
    yield Case(
        *("Earth's rate at 38 deg", "bias", 1e6 * K * EARTH_DEG_S * math.sin(math.radians(38.0)), 0.1, "uV", bias_uv),
        turned("site", latitude_deg=38.0),
    )
    c2, c3 = -1.06e-7, 3.3e-10
    stage = turned("output_stage", second_order_per_v=c2 / K**2, third_order_per_v2=c3 / K**3)
    yield Case("curved output stage", "scale factor", 1e6 * c3 * S4 / SXX / K, 2.0, "ppm", slope_ppm, stage)
    yield Case("curved output stage", "bias", 1e6 * c2 * SXX / 17.0, 1.0, "uV", bias_uv, stage)
    quadrature = {name: {"quadrature_rad_s": math.radians(100.0)} for name in ("sense_in_phase", "sense_anti_phase")}
    leak = [sum((1j * cmath.exp(-1j * math.radians(e)) / a).real for a in none) for e in (0.0, 1.0)]
    rotated = {**quadrature, "sense_path": {"demodulator_phase_rad": math.pi + math.radians(1.0)}}
    name = "demodulator 1 deg off, 100 deg/s of quadrature"
    demodulated_uv = 1e6 * K * -100.0 * (leak[1] - leak[0]) / base
    yield Case(name, "bias", demodulated_uv, 20.0, "uV", bias_uv, rotated, against=quadrature)
    for angle_deg in (-5.0, 5.0):
        carrier = turned("virtual_path", carrier_phase_rad=math.pi + math.radians(angle_deg))
        change = 1e6 * (gain(*none, phase_deg=angle_deg) / base - 1.0)
        yield Case(f"carrier {angle_deg:+g} deg off", "K_Vc", change, 20.0, "ppm", k_vc_ppm, carrier)
        yield Case(f"carrier {angle_deg:+g} deg off", "virtual against table", 0.0, 5.0, "ppm", difference_ppm, carrier)
    combs = GYRO.virtual_path.left_comb_n_per_v2
    unequal = turned("virtual_path", left_comb_n_per_v2=1.01 * combs, right_comb_n_per_v2=0.99 * combs)
    change = 1e6 * (gain(*none, shares=(1.0 + 0.01 * (0.8 - 0.2), 1.0)) / base - 1.0)
    yield Case("unequal combs, +-1 %", "K_Vc", change, 20.0, "ppm", k_vc_ppm, unequal)
    yield Case("unequal combs, +-1 %", "virtual against table", 0.0, 5.0, "ppm", difference_ppm, unequal)
    yield from of_the_drive_and_split(base)
    yield from of_feedthrough(base)
    yield from of_the_warm_up()
    yield from of_noise()


def of_instruments() -> Iterator[Case]:
    """Yield what meter, table and generator do."""
    yield Case("meter's gain, 35 ppm", "scale factor", 35.0, 0.5, "ppm", slope_ppm, errors=meter(gain_error=35e-6))
    yield Case("meter's gain, 35 ppm", "K_Vc", 0.0, 1.0, "ppm", k_vc_ppm, errors=meter(gain_error=35e-6))
    yield Case("meter's offset, 50 uV", "bias", 50.0, 0.5, "uV", bias_uv, errors=meter(offset_v=50e-6))
    table = turned("table", rate_error=10e-6)
    yield Case("table's rate, 10 ppm", "scale factor", 10.0, 0.5, "ppm", slope_ppm, table)
    yield Case("table's rate, 10 ppm", "K_Vc", -10.0, 0.5, "ppm", k_vc_ppm, table)
    yield Case("table's rate, 10 ppm", "virtual against table", 0.0, 1.0, "ppm", difference_ppm, table)
    yield of_ripple()
    yield of_flutter()
    askew, tilt_ppm = turned("table", misalignment_deg=2.0), 1e6 * (math.cos(math.radians(2.0)) - 1.0)
    yield Case("gyroscope's axis 2 deg askew", "scale factor", tilt_ppm, 0.5, "ppm", slope_ppm, askew)
    inverse_ppm = 1e6 * (1.0 / math.cos(math.radians(2.0)) - 1.0)
    yield Case("gyroscope's axis 2 deg askew", "K_Vc", inverse_ppm, 0.5, "ppm", k_vc_ppm, askew)
    yield Case("gyroscope's axis 2 deg askew", "virtual against table", 0.0, 1.0, "ppm", difference_ppm, askew)
    whole, stepped = ranges((10.0, 0.01, 0.0)), ranges((0.32, 0.0, 0.0), (10.0, 0.01, 0.0))
    yield Case("generator's gain, 1 %", "K_Vc", 1e4, 20.0, "ppm", k_vc_ppm, errors=whole)
    yield Case("generator's gain, 1 %", "virtual against table", 0.0, 5.0, "ppm", difference_ppm, errors=whole)
    above = 2.0 * (200.0**2 + 100.0**2 + 50.0**2) / SXX
    name = "generator's gain, 1 % above 0.32 V"
    yield Case(name, "virtual against table", 1e4 * above, 20.0, "ppm", difference_ppm, errors=stepped)
    offset = ranges((10.0, 0.0, 2e-3))
    yield Case(
        *("generator's offset, 2 mV", "virtual less table's bias", 1e6 * K * K_VC * 2e-3, 10.0, "uV"),
        bias_difference_uv,
        errors=offset,
    )
    yield Case("generator's offset, 2 mV", "K_Vc", 0.0, 20.0, "ppm", k_vc_ppm, errors=offset)
    level_v = 10.0 / K_VC
    yield Case(
        *("the same, match=absolute", "K_Vc", 1e6 * (level_v / (level_v - 2e-3) - 1.0), 50.0, "ppm", k_vc_ppm),
        errors=offset,
        settings={"match": "absolute"},
    )


def of_ripple() -> Case:
    """Return a ripple of the table once a turn: ten readings in one turn of 10 s see its rate at even angles.

    The meter's noise is on, since a run ends whose windows have none of what others have.
    """
    turn_hz, noise_v = 0.1, 40e-6
    swing_v = abs(K) * 100.0 / 3600.0 * 2.0 * math.pi * turn_hz * float(np.sinc(0.2 * turn_hz))
    scatter_uv = 1e6 * math.hypot(swing_v * math.sqrt(0.5 * 10.0 / 9.0), noise_v)

    def seen(run: Any, _ideal: Any) -> float:
        return 1e6 * math.sqrt(np.mean([point.std_v**2 for point in run.points if abs(point.rate_deg_s) == 36.0]))

    return Case(
        *("table's ripple, 100 arcsec once a turn", "scatter at 36 deg/s", scatter_uv, 8.0, "uV", seen),
        turned("table", ripple_arcsec=[100.0], ripple_harmonic=[1], ripple_phase_rad=[0.4]),
        errors=meter(noise=4.0),
        procedure="turntable",
        settings={"rates_deg_s": [72.0, 36.0, -36.0, -72.0]},
    )


def of_flutter() -> Case:
    """Return flutter of 100 ppm/sqrt(Hz) of the rate at the loop's 25 Hz: what readings of 0.2 s scatter by it.

    The meter's noise of 40 uV is on, for the same reason as above.
    """
    rates_deg_s, share = [200.0, 190.0, 180.0, 170.0, -170.0, -180.0, -190.0, -200.0], 100e-6
    f = np.linspace(0.0, 500.0, 500_001)[1:]
    damped = (2.0 * 0.8 * 25.0 * f) ** 2
    density = share**2 * damped / ((25.0**2 - f**2) ** 2 + damped)
    seen_by = rate_answer(f) ** 2 / (1.0 + (f / 100.0) ** 8) * np.sinc(0.2 * f) ** 2
    turning_deg_s = math.sqrt(np.mean(np.square(rates_deg_s)))
    shaken_v = abs(K) * turning_deg_s * math.sqrt(float(np.trapezoid(density * seen_by, f)))
    scatter_uv = 1e6 * math.hypot(shaken_v, 40e-6)

    def seen(run: Any, _ideal: Any) -> float:
        return 1e6 * math.sqrt(np.mean([point.std_v**2 for point in run.points if point.rate_deg_s]))

    return Case(
        *("table's flutter, 100 ppm/sqrt(Hz)", "scatter at 170 to 200 deg/s", scatter_uv, 0.2 * scatter_uv, "uV", seen),
        turned("table", flutter_per_sqrt_hz=share),
        meter(noise=4.0),
        against=None,
        procedure="turntable",
        settings={"rates_deg_s": rates_deg_s, "rate_tolerance_deg_s": 1.0},
    )


def of_the_modulator() -> Iterator[Case]:
    """Yield what the modulator's offset and curvature do."""
    leaking = turned("virtual_path", offset_v=51.7e-3 / (K * K_VC))
    yield Case(
        *("modulator's offset, 27 mV", "virtual less table's bias", 51.7e3, 10.0, "uV", bias_difference_uv), leaking
    )
    level_v = 10.0 / K_VC
    even, odd = turned("virtual_path", second_order_per_v=0.013), turned("virtual_path", third_order_per_v2=0.0145)
    yield Case("modulator's 2nd order, 0.013/V", "K_Vc", 1e6 * 0.013 * level_v, 5.0, "ppm", k_vc_ppm, even)
    slope = 1e6 * 0.0145 / K_VC**2 * (S4 / SXX - 100.0)
    yield Case("modulator's 3rd order, 0.0145/V2", "virtual against table", slope, 60.0, "ppm", difference_ppm, odd)


def of_the_drive_and_split(base: float) -> Iterator[Case]:
    """Yield what drive amplitude, carrier, split, temperature do to scale factor and K_Vc."""
    larger = turned("drive_loop", amplitude_m=5.05e-6)
    yield Case("drive amplitude, +1 %", "scale factor", 1e4, 10.0, "ppm", slope_ppm, larger)
    yield Case("drive amplitude, +1 %", "K_Vc", 1e6 * (1.0 / 1.01 - 1.0), 10.0, "ppm", k_vc_ppm, larger)
    both = {**larger, "sense_path": {"reference_amplitude_v": 2.02}}
    yield Case("drive and carrier, +1 %", "K_Vc", 0.0, 5.0, "ppm", k_vc_ppm, both)
    changes = {"drive_loop": {"amplitude_supply_coefficient_per_v": 200e-6}, "supply": {"nominal_v": 9.0}}
    change = 1e6 * ((1.0 + 200e-6) ** 2 - 1.0)  # the drive itself, and the demodulator's reference, which follows it
    yield Case("amplitude by 200 ppm/V, 1 V more", "scale factor", change, 1.0, "ppm", slope_ppm, changes)
    yield Case("amplitude by 200 ppm/V, 1 V more", "K_Vc", 0.0, 1.0, "ppm", k_vc_ppm, changes)
    near = turned("sense_anti_phase", frequency_hz=3464.1 - 0.05)
    change = 1e6 * (gain(*modes(anti_frequency=-0.05 / 3464.1)) / base - 1.0)
    yield Case("split, +0.05 Hz", "scale factor", change, 5.0, "ppm", slope_ppm, near)
    yield Case("split, +0.05 Hz", "K_Vc", 0.0, 5.0, "ppm", k_vc_ppm, near)
    warm = {
        "thermal": {"ambient_c": 21.0},
        "sense_in_phase": {"frequency_coefficient_per_k": 1e-6},
        "sense_anti_phase": {"frequency_coefficient_per_k": 1e-6},
    }
    change = 1e6 * (gain(*modes(in_frequency=1e-6, anti_frequency=1e-6)) / base - 1.0)
    yield Case("1 K, split by 1 ppm/K", "scale factor", change, 3.0, "ppm", slope_ppm, warm)
    damped = {name: {"quality": 1224.0 * 1.01} for name in ("sense_in_phase", "sense_anti_phase")}
    quadrature = {name: {**of, "quadrature_rad_s": math.radians(100.0)} for name, of in damped.items()}
    changed = modes(in_quality=0.01, anti_quality=0.01)
    leak = sum((1j / a).real for a in changed) - sum((1j / a).real for a in modes())
    name, leak_uv = "Q of the sense modes +1 %, 100 deg/s of quadrature", 1e6 * K * -100.0 * leak / base
    without = {mode: {"quadrature_rad_s": math.radians(100.0)} for mode in damped}
    yield Case(name, "bias", leak_uv, 10.0, "uV", bias_uv, quadrature, against=without)
    heated = turned("thermal", self_heating_k=0.3, bias_coefficient_deg_s_k=30.0 / 3600.0)
    yield Case(
        *("bias 30 deg/h/K, 0.3 K of own heat", "bias, warm", 1e6 * K * 9.0 / 3600.0, 0.3, "uV", bias_uv, heated),
        settings={"warm_up_s": 3600.0},
    )


def of_feedthrough(base: float) -> Iterator[Case]:
    """Yield what the carrier does that is in V_s without motion: a rate of 1 deg/s makes V_s of so many volts."""
    acceleration_m_s2 = 2.0 * math.radians(1.0) * 5e-6 * 2.0 * math.pi * 3488.9
    sensed_v = 10.0 * 10.0 * 2e5 * acceleration_m_s2 * base
    carrier = turned("sense_path", carrier_feedthrough=1e-5)
    yield Case("carrier in V_s, 1e-5", "bias", 1e6 * K * 1e-5 * 2.0 / sensed_v, 1.0, "uV", bias_uv, carrier)
    modulated, change = turned("sense_path", v_vc_feedthrough=1e-3), 1e6 * 1e-3 / sensed_v / K_VC
    yield Case("modulated V_Vc in V_s, 1e-3", "K_Vc", change, 1.0, "ppm", k_vc_ppm, modulated)
    yield Case("modulated V_Vc in V_s, 1e-3", "virtual against table", 0.0, 1.0, "ppm", difference_ppm, modulated)


def of_the_warm_up() -> Iterator[Case]:
    """Yield what the output at rest does from power-on: b_inf - b dT exp(-t / tau).

    The meter's noise is on, which scatters its steps of 10 uV.
    """
    heated = turned("thermal", self_heating_k=3.0, time_constant_s=300.0, bias_coefficient_deg_s_k=30.0 / 3600.0)
    settings = {"bias_instability_deg_h": 0.1, "scale_factor_v_per_deg_s": K}
    found: tuple[tuple[str, float, float, str, Callable[[Any, Any], float]], ...] = (
        ("amplitude of the warm-up", -90.0, 1.0, "deg/h", lambda run, _: 3600.0 * float(run.results.amplitude.value)),
        ("time constant", 300.0, 8.0, "s", lambda run, _: float(run.results.time_constant.value)),
        ("time to 0.1 deg/h", 300.0 * math.log(900.0), 50.0, "s", lambda run, _: float(run.results.warm_up.value)),
    )
    for what, predicted, tolerance, unit, seen_in in found:
        yield Case(
            *("bias 30 deg/h/K, 3 K of own heat", what, predicted, tolerance, unit, seen_in, heated),
            errors=meter(noise=1.0),
            against=None,
            procedure="warmup",
            settings=settings,
        )


def of_noise() -> Iterator[Case]:
    """Yield what a zero record of an hour sees of the gyroscope's noise, one reading of 0.2 s a second."""
    record: dict[str, Any] = {
        "against": None,
        "procedure": "zero",
        "settings": {"mode": "dead-time", "scale_factor_v_per_deg_s": K},
    }
    walk = turned("noise", angle_random_walk_deg_sqrt_s=0.21 / 60.0)
    as_read = 0.21 * math.sqrt(2.0 * noise_bandwidth_hz(0.2))
    yield Case(
        *("angle random walk, 0.21 deg/sqrt(h)", "N as it is read", as_read, 0.03, "deg/sqrt(h)"),
        lambda run, _: float(run.results.angle_random_walk_as_read),
        walk,
        **record,
    )
    flicker = turned("noise", bias_instability_deg_s=5.57 / 3600.0)
    yield Case(
        *("flicker, B = 5.57 deg/h", "Allan deviation at 8 s", 5.57 * math.sqrt(2.0 * math.log(2.0) / math.pi), 0.45),
        *("deg/h", lambda run, _: next(row.observed for row in run.results.allan_deg_h if row.tau_s >= 7.9), flicker),
        **record,
    )


def run_of(case: Case, override: Mapping[str, Any], errors: Mapping[str, Any], where: str) -> Any:
    """Run the calibration of `case` on the ideal bench with that."""
    simulation = structs.replace(
        SIMULATION,
        errors=structs.replace(SIMULATION.errors, **errors),
        override={name: dict(values) for name, values in override.items()},
    )
    bench = structs.replace(IDEAL, simulation=simulation)
    run = vcfbench.run(case.procedure, bench, seed=1, settings=dict(case.settings), runs=where)
    if run.results is None:
        raise SystemExit(f"{case.name}: {run.error}")
    return run


def seen() -> Iterator[tuple[Case, float]]:
    """Yield each case with what was seen of it."""
    known: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as where:

        def run(case: Case, override: Mapping[str, Any], errors: Mapping[str, Any]) -> Any:
            key = repr((case.procedure, case.settings, override, errors))
            if key not in known:
                known[key] = run_of(case, override, errors, where)
            return known[key]

        for case in cases():
            without = None if case.against is None else run(case, case.against, {})
            yield case, case.seen(run(case, case.override, case.errors), without)


def main() -> int:
    print(f"{'imperfection':52} {'seen in':27} {'predicted':>12} {'seen':>12}")
    failed = False
    for case, value in seen():
        wrong = not abs(value - case.predicted) <= case.tolerance
        failed |= wrong
        mark = "  *" if wrong else ""
        print(f"{case.name:52} {case.what:27} {case.predicted:+12.6g} {value:+12.6g} {case.unit}{mark}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
