"""Gyroscopes of the paper's kind, drawn by seed, and their simulated benches.

Drive at 1 to 50 kHz, the sense mode 3 to 80 Hz below or above it, quality factors from 100 to 1e5, quadrature up to 300
deg/s, scale factors over three decades and K_Vc of either sign, rails of 5 to 15 V and ranges that go with them.
"""

import math
from random import Random
from typing import Any

from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.sim.gyro.data_sheet import OUTPUT_SHARE, DataSheet
from vcfbench.sim.own_gyro import TABLE_RATE_ERROR, own_gyro_bench


def drawn_sheet(seed: int) -> DataSheet:
    """Return the data sheet of the gyroscope of a seed; figures that no device has together are drawn again."""
    random = Random(f"gyroscope {seed}")  # noqa: S311  # data sheets, no secrets
    while True:
        try:
            return DataSheet(**_figures(random))
        except ConfigError:
            continue


def drawn_bench(seed: int, *, imperfections: bool = True, noise: bool = True) -> str:
    """Return the bench file, named ``gyroscope-SEED``, with the gyroscope of a seed.

    Args:
        seed: of the gyroscope; the instruments are drawn by that of the run.
        imperfections: as large as the paper's, of gyroscope, PCB and instruments, the table's drawn within what its
            bench file says of it; else none but quadrature.
        noise: that of the data sheet; else none.
    """
    sheet = drawn_sheet(seed)
    if not noise:
        sheet = replace(sheet, angle_random_walk_deg_sqrt_h=0.0, bias_instability_deg_h=0.0)
    text = own_gyro_bench(sheet, f"gyroscope-{seed}", imperfections=imperfections)
    if not imperfections:
        return text
    random = Random(f"table {seed}")  # noqa: S311  # rates, no secrets
    phases_rad = [random.uniform(-math.pi, math.pi) for _ in range(2)]
    rate_error = random.uniform(-TABLE_RATE_ERROR, TABLE_RATE_ERROR)
    return f"{text}\n[simulation.override.table]\nrate_error = {rate_error!r}\nripple_phase_rad = {phases_rad!r}\n"


def _figures(random: Random) -> dict[str, Any]:
    def between(low: float, high: float) -> float:
        return float(f"{math.exp(random.uniform(math.log(low), math.log(high))):.4g}")

    def either(size: float) -> float:
        return random.choice((-1.0, 1.0)) * size

    rail_v, range_deg_s = 0.5 * random.randrange(10, 31), between(20.0, 900.0)
    return {
        "scale_factor_v_per_deg_s": either(float(f"{between(0.3, 0.95 * OUTPUT_SHARE * rail_v) / range_deg_s:.6g}")),
        "range_deg_s": range_deg_s,
        "bias_deg_s": either(float(f"{random.uniform(0.0, 0.05) * range_deg_s:.4g}")),
        "drive_hz": between(1000.0, 50_000.0),
        "q_drive": between(100.0, 1e5),
        "split_hz": either(between(3.0, 80.0)),
        "q_sense": between(100.0, 1e5),
        "quadrature_deg_s": float(f"{random.uniform(0.0, 300.0):.4g}"),
        "angle_random_walk_deg_sqrt_h": between(0.01, 2.0),
        "bias_instability_deg_h": between(0.1, 50.0),
        "k_vc_deg_s_per_v": either(float(f"{range_deg_s / between(0.5, 8.0):.4g}")),
        "rail_v": rail_v,
    }
