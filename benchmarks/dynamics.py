"""Split, Q and the band of random gyroscopes by `run bandwidth`, against their parameters: sd of z, 1 is true.

    python benchmarks/dynamics.py [GYROS [FIRST_SEED]]

Each gyroscope is another: frequencies, quality factors, pick-offs, phases; each instrument is drawn from its data
sheet. The truth is the closed form of docs/theory.md with P and R, which the procedure does not use.
"""

from __future__ import annotations

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

import vcfbench
from vcfbench.testing import simulated

QUANTITIES = ("split_hz", "q", "plus_3_db_hz", "peak_hz", "peak_gain", "minus_3_db_hz")
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
        "drive_mode": {"frequency_hz": drive_hz},
        **modes,
        "sense_path": {"demodulator_phase_rad": np.pi + draw(-0.03, 0.03)},
        "virtual_path": {"carrier_phase_rad": np.pi + draw(-0.03, 0.03)},
    }


def truth(parameters: Any) -> dict[str, float]:
    """Return what a warm gyroscope of these parameters has; frequencies in Hz."""
    drive, sense, path = parameters.drive_mode, parameters.sense_anti_phase, parameters.virtual_path

    def warm_hz(mode: Any) -> float:
        return float(mode.frequency_hz * (1.0 + WARM_K * mode.frequency_coefficient_per_k))

    def warm_q(mode: Any) -> float:
        return float(mode.quality * (1.0 + WARM_K * mode.quality_coefficient_per_k))

    phase = path.carrier_phase_rad - parameters.sense_path.demodulator_phase_rad
    driven = 2.0 * np.pi * warm_hz(drive)

    def response(at_hz: float) -> float:
        s = 2j * np.pi * at_hz
        total = 0j
        for mode in (parameters.sense_in_phase, sense):
            w, q = 2.0 * np.pi * warm_hz(mode), warm_q(mode)
            force = (
                mode.left_participation * path.left_comb_n_per_v2 + mode.right_participation * path.right_comb_n_per_v2
            )
            p, r = s**2 + w / q * s + w**2 - driven**2, 2.0 * s * driven + w * driven / q
            total += mode.pick_off_v_per_m * force * (p * np.cos(phase) + r * np.sin(phase)) / (p**2 + r**2)
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


def z_scores(seed: int) -> list[float]:
    """Return (measured - true) / u of every quantity of one gyroscope."""
    bench = simulated("paper", errors="drawn", overrides=gyroscope(seed))
    with tempfile.TemporaryDirectory() as runs:
        run = vcfbench.run("bandwidth", bench, seed=seed, runs=runs)
    if run.results is None:
        raise RuntimeError(f"seed {seed}: {run.error or run.no_results}")
    true = truth(_parameters(bench))
    found = [(getattr(run.results, name), true[name]) for name in QUANTITIES]
    return [(each.value - value) / each.u for each, value in found]


def _parameters(bench: vcfbench.BenchDescription) -> Any:
    from vcfbench.bench.overrides import overridden  # noqa: PLC0415
    from vcfbench.sim.gyro.design import paper_bench  # noqa: PLC0415

    if bench.simulation is None:
        raise ValueError("these are the parameters of no simulation")
    return overridden(paper_bench(), bench.simulation.override)


def main(count: int = 50, first: int = 0) -> None:
    with ProcessPoolExecutor(2) as pool:
        z = np.array(list(pool.map(z_scores, range(first, first + count))))
    for name, column in zip(QUANTITIES, z.T, strict=True):
        within = int((np.abs(column) < 1.96).sum())
        print(f"{name:14} mean z {column.mean():+.2f}, sd {column.std(ddof=1):.2f}, {within} of {count} within 1.96 u")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
