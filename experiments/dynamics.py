"""Bands, phases and resonances of random gyroscopes against their parameters: sd of z, 1 is true of many records.

    python experiments/dynamics.py [GYROS [FIRST_SEED [bandwidth|phase|resonance]]]

Of few records z is Student's, wider than 1; whether U95 holds the truth counts then.

Each gyroscope is another: frequencies, quality factors, pick-offs, phases; each instrument is drawn from its data
sheet. The truth is the closed form of docs/theory.md with P and R, which the procedure does not use. The exit code is 1
where U95 holds it too often or too rarely (limits.py).
"""

from __future__ import annotations

import math
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from limits import outside
from scipy.optimize import brentq, minimize_scalar

import vcfbench
from vcfbench.errors import BenchError
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from vcfbench.values.value import Measurand

WARM_K = 0.3
"""The paper's gyroscope heats itself by so much, in bands of 0.02 K."""


def gyroscope(seed: int) -> dict[str, Any]:
    """Return overrides of one gyroscope."""
    draw = np.random.default_rng(seed).uniform
    drive_hz = draw(3479.0, 3499.0)
    modes = {
        "sense_in_phase": {"frequency_hz": drive_hz - draw(125.0, 170.0), "quality": draw(700.0, 2200.0)},
        "sense_anti_phase": {"frequency_hz": drive_hz - draw(16.0, 34.0), "quality": draw(700.0, 2200.0)},
    }
    for mode in modes.values():
        mode["pick_off_v_per_m"] = 2e5 * draw(0.9, 1.1)
    return {
        **modes,
        "sense_path": {"demodulator_phase_rad": np.pi + draw(-0.03, 0.03)},
        "virtual_path": {"carrier_phase_rad": np.pi + draw(-0.03, 0.03)},
        "drive_mode": {"frequency_hz": drive_hz, "quality": draw(1000.0, 2000.0)},
    }


def warm_hz(mode: Any) -> float:
    return float(mode.frequency_hz * (1.0 + WARM_K * mode.frequency_coefficient_per_k))


def warm_q(mode: Any) -> float:
    return float(mode.quality * (1.0 + WARM_K * mode.quality_coefficient_per_k))


def combs(mode: Any, path: Any) -> float:
    """Return the force of V_Vc on a mode."""
    return float(
        mode.left_participation * path.left_comb_n_per_v2 + mode.right_participation * path.right_comb_n_per_v2
    )


def phases(parameters: Any) -> dict[str, float]:
    """Return the phases of a warm gyroscope against its drive signal -A cos, deg, by the force's complex response."""
    path, driven = parameters.virtual_path, warm_hz(parameters.drive_mode)
    by_rate = by_v_vc = 0j
    for mode in (parameters.sense_in_phase, parameters.sense_anti_phase):
        own = warm_hz(mode)
        passed = mode.pick_off_v_per_m / complex(own**2 - driven**2, own * driven / warm_q(mode))
        by_rate += passed * (mode.left_participation + mode.right_participation)
        by_v_vc += passed * combs(mode, path)
    coriolis = np.degrees(np.angle(by_rate)) - 90.0
    virtual = np.degrees(np.angle(by_v_vc) + path.carrier_phase_rad) - 270.0
    demodulator = np.degrees(parameters.sense_path.demodulator_phase_rad) - 270.0
    seen, aside = (np.cos(np.radians(each - demodulator)) for each in (virtual, coriolis))
    return {
        "carrier_deg": np.degrees(path.carrier_phase_rad) - 270.0,
        "coriolis_deg": coriolis,
        "virtual_deg": virtual,
        "demodulator_deg": demodulator,
        "virtual_from_coriolis_deg": virtual - coriolis,
        "demodulator_from_coriolis_deg": demodulator - coriolis,
        "k_vc_error_ppm": 1e6 * (seen / aside - 1.0),
    }


def band(parameters: Any) -> dict[str, float]:
    """Return the band of a warm gyroscope; frequencies in Hz."""
    drive, sense, path = parameters.drive_mode, parameters.sense_anti_phase, parameters.virtual_path
    phase = path.carrier_phase_rad - parameters.sense_path.demodulator_phase_rad
    driven = 2.0 * np.pi * warm_hz(drive)

    def response(at_hz: float) -> float:
        s = 2j * np.pi * at_hz
        total = 0j
        for mode in (parameters.sense_in_phase, sense):
            w, q = 2.0 * np.pi * warm_hz(mode), warm_q(mode)
            p, r = s**2 + w / q * s + w**2 - driven**2, 2.0 * s * driven + w * driven / q
            total += mode.pick_off_v_per_m * combs(mode, path) * (p * np.cos(phase) + r * np.sin(phase)) / (p**2 + r**2)
        return float(abs(total))

    split, static = warm_hz(drive) - warm_hz(sense), response(0.0)
    peak = float(
        minimize_scalar(
            lambda f: -response(f), bounds=(0.7 * split, 1.3 * split), method="bounded", options={"xatol": 1e-9}
        ).x
    )
    return {
        "split_hz": split,
        "q": warm_q(sense),
        "plus_3_db_hz": float(brentq(lambda f: response(f) / static - np.sqrt(2.0), 0.0, peak)),
        "peak_hz": peak,
        "peak_gain": response(peak) / static,
        "minus_3_db_hz": float(brentq(lambda f: response(f) / static - np.sqrt(0.5), peak, 2.0 * peak)),
    }


def resonances(parameters: Any) -> dict[str, float]:
    """Return the modes of a warm gyroscope; frequencies in Hz."""
    drive, anti_phase, in_phase = parameters.drive_mode, parameters.sense_anti_phase, parameters.sense_in_phase
    split = warm_hz(drive) - warm_hz(anti_phase)
    return {
        "drive_hz": warm_hz(drive),
        "drive_ring_down_hz": warm_hz(drive),
        "drive_q": warm_q(drive),
        "sense_hz": warm_hz(anti_phase),
        "sense_q_ring_down": warm_q(anti_phase),
        "sense_q_sweep": warm_q(anti_phase),
        "split_ring_down_hz": split,
        "split_sweep_hz": split,
        "in_phase_hz": warm_hz(in_phase),
        "in_phase_q": warm_q(in_phase),
    }


TRUTHS = {"bandwidth": band, "phase": phases, "resonance": resonances}


def scores(procedure: str, seed: int) -> dict[str, tuple[float, bool]] | str:
    """Return (measured - true) / u of every quantity of one gyroscope, and whether U95 holds it; or why not."""
    bench = simulated("paper", errors="drawn", overrides=gyroscope(seed))
    with tempfile.TemporaryDirectory() as runs:
        try:
            run = vcfbench.run(procedure, bench, seed=seed, runs=runs)
        except BenchError as error:
            return f"seed {seed}: {error}"
    found = {}
    for name, true in TRUTHS[procedure](_parameters(bench)).items():
        each = getattr(run.results, name)
        if each is None:
            return f"seed {seed}: no {name}"
        off = _off(each, true)
        found[name] = (off / each.u, abs(off) < each.u95)
    return found


def _off(found: Measurand, true: float) -> float:
    """Return measured less true; angles apart from half turns."""
    off = found.value - true
    return math.remainder(off, 180.0) if found.unit == "deg" else off


def _parameters(bench: vcfbench.BenchDescription) -> Any:
    from vcfbench.sim.gyro.design import paper_bench  # noqa: PLC0415
    from vcfbench.station.overrides import overridden  # noqa: PLC0415

    if bench.simulation is None:
        raise ValueError("these are the parameters of no simulation")
    return overridden(paper_bench(), bench.simulation.override)


def main(count: str = "50", first: str = "0", procedure: str = "bandwidth") -> int:
    seeds = range(int(first), int(first) + int(count))
    with ProcessPoolExecutor(2) as pool:
        answers = list(pool.map(scores, [procedure] * len(seeds), seeds))
    found = [each for each in answers if not isinstance(each, str)]
    print(*(each for each in answers if isinstance(each, str)), f"{len(found)} of {count} gyroscopes", sep="\n")
    good = len(found) == len(seeds)
    for name in found[0]:
        z, within = np.array([each[name][0] for each in found]), [each[name][1] for each in found]
        beyond = outside(within)
        good = good and not beyond
        mark = f"  * {beyond}" if beyond else ""
        print(f"{name:30} mean z {z.mean():+.2f}, sd {z.std(ddof=1):.2f}, {sum(within)} within U95{mark}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
