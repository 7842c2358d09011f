"""What a cause does to a gyroscope's scale factor, and what a virtual rate shows of it: open loop, force balance.

    python force_balance.py [LOOP_GAIN]

The sense mode of the paper in its slow flow: it answers a force in phase by h = P/(P^2 + R^2), with P = w_y^2 - w_d^2
and R = w_y w_d/Q. The Coriolis force is c x a rate, with the drive's amplitude x; the combs make k V of V_Vc, and V_Vc
is modulated by the drive's own carrier, so that k follows x.

Open loop: output = g h (c x rate + k V). Force balance with loop gain L (L at the nominal values): the output is the
voltage F that holds the mode still, F = -L' (c x rate/k + V)/(1 + L'), where L' = L g h k over its nominal value.
"""

from __future__ import annotations

import sys
from math import tau

DRIVE_HZ, SPLIT_HZ, Q = 3488.9, 24.8, 1224.0
NOMINAL = {"split_hz": SPLIT_HZ, "q": Q, "read_out": 1.0, "drive": 1.0, "combs": 1.0}
CAUSES = {
    "split +0.05 Hz": {"split_hz": SPLIT_HZ + 0.05},
    "Q -20 %": {"q": 0.8 * Q},
    "read-out gain +1 %": {"read_out": 1.01},
    "drive amplitude +1 %, carrier in step": {"drive": 1.01},
    "combs +1 % (force per volt)": {"combs": 1.01},
}


def slopes(loop_gain: float | None, values: dict[str, float]) -> tuple[float, float]:
    """Return what the output moves by the rate and by V_Vc; `loop_gain` None is the open loop."""
    drive, sense = tau * DRIVE_HZ, tau * (DRIVE_HZ - values["split_hz"])
    stiff, lossy = sense**2 - drive**2, sense * drive / values["q"]
    h = stiff / (stiff**2 + lossy**2)
    coriolis, combs = values["drive"], values["combs"] * values["drive"]
    if loop_gain is None:
        return values["read_out"] * h * coriolis, values["read_out"] * h * combs
    rate, voltage = slopes(None, values)
    gain = loop_gain * voltage / slopes(None, NOMINAL)[1]
    return -gain / (1.0 + gain) * rate / voltage, -gain / (1.0 + gain)


def changes_ppm(loop_gain: float | None, values: dict[str, float]) -> tuple[float, float]:
    """Return the change of the scale factor, and what V_Vc shows as its change, ppm."""
    now, then = slopes(loop_gain, values), slopes(loop_gain, NOMINAL)
    rate, voltage = (1e6 * (after / before - 1.0) for after, before in zip(now, then, strict=True))
    return rate, voltage


def main() -> None:
    """Print the table: for each cause the change, what V_Vc shows, and what is left when that is corrected, ppm."""
    loop_gain = float(sys.argv[1]) if len(sys.argv) > 1 else 1e6
    loops = {"open loop": None, f"force balance, L = {loop_gain:g}": loop_gain}
    print(f"{'ppm':38}" + "".join(f"{name:^36}" for name in loops))
    print(f"{'cause':38}" + f"{'K':>12}{'V_Vc shows':>12}{'left':>12}" * len(loops))
    for cause, change in CAUSES.items():
        found = [changes_ppm(gain, NOMINAL | change) for gain in loops.values()]
        print(f"{cause:38}" + "".join(f"{round(k):12}{round(seen):12}{round(k - seen):12}" for k, seen in found))


if __name__ == "__main__":
    main()
