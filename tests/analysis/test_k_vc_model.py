"""The closed form of K_Vc against the carrier-level equations of motion, integrated over a cycle, as docs/theory.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from scipy.integrate import solve_ivp

from vcfbench.analysis.k_vc_model import QUANTITIES, Gyroscope, change_ppm, sensitivities

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


@dataclass(frozen=True)
class Device:
    """A gyroscope by its physical parameters, one unit of mass: frequencies in Hz, in phase first."""

    drive_hz: float = 3488.9 * (1.0 - 30e-6 * 0.3)
    sense_hz: tuple[float, float] = (3342.0 * (1.0 - 31e-6 * 0.3), 3464.1 * (1.0 - 31e-6 * 0.3))
    q: tuple[float, float] = (1224.0 * (1.0 - 2e-3 * 0.3), 1224.0 * (1.0 - 2e-3 * 0.3))
    left: tuple[float, float] = (0.8, 0.5)
    right: tuple[float, float] = (0.2, 0.5)
    pick_off: tuple[float, float] = (1.0, 1.0)
    combs: tuple[float, float] = (1.01, 0.99)
    carrier_rad: float = math.pi + math.radians(0.3)
    demodulator_rad: float = math.pi - math.radians(0.5)
    drive_m: float = 1.0
    carrier_v: float = 1.0
    through: float = 0.0

    def force(self, mode: int) -> float:
        """Return what the combs do to a mode."""
        return self.left[mode] * self.combs[0] + self.right[mode] * self.combs[1]


def k_vc(device: Device) -> float:
    """Return what a volt of V_Vc does over what a rate of 1 rad/s does, behind the demodulator, by integration."""
    return _demodulated(device, 0.0, 1.0) / _demodulated(device, 1.0, 0.0)


def _demodulated(device: Device, rate_rad_s: float, v_vc_v: float) -> float:
    """Return the mean of the demodulator's product over a cycle of the steady state that the modes come to.

    The equations are linear and periodic: what one cycle makes of five states gives the one that returns.
    """
    drive = 2.0 * math.pi * device.drive_hz
    own = 2.0 * math.pi * np.array(device.sense_hz)

    def moves(t: float, flat: NDArray[np.float64]) -> NDArray[np.float64]:
        state = flat.reshape(5, -1)
        turn = drive * t
        velocity = device.drive_m * drive * math.sin(turn)  # x = -A cos
        carrier = device.carrier_v * math.sin(turn + device.carrier_rad)
        change = np.empty_like(state)
        seen: Any = device.through * v_vc_v * carrier
        for mode in (0, 1):
            place, speed = state[2 * mode], state[2 * mode + 1]
            share = device.left[mode] + device.right[mode]
            force = -2.0 * rate_rad_s * share * velocity + v_vc_v * device.force(mode) * carrier
            change[2 * mode] = speed
            change[2 * mode + 1] = force - own[mode] / device.q[mode] * speed - own[mode] ** 2 * place
            seen = seen + device.pick_off[mode] * place
        change[4] = seen * math.sin(turn + device.demodulator_rad)
        return change.ravel()

    scale = np.array([1.0, drive, 1.0, drive, 1.0 / drive])[:, None] * 1e-7
    begun = np.hstack([np.zeros((5, 1)), np.eye(5)[:, :4]]) * scale
    done = solve_ivp(moves, (0.0, 1.0 / device.drive_hz), begun.ravel(), method="DOP853", rtol=1e-12, atol=1e-19)
    ended = done.y[:, -1].reshape(5, -1)
    forced, free = ended[:, 0], (ended[:, 1:] - ended[:, :1]) / scale[:4, 0]
    start = np.linalg.solve(np.eye(4) - free[:4], forced[:4])
    return float((forced[4] + free[4] @ start) * device.drive_hz)


def measured(device: Device) -> Gyroscope:
    """Return the gyroscope as procedures would measure it."""
    stiffness = [each**2 - device.drive_hz**2 for each in device.sense_hz]
    part = [device.pick_off[mode] * device.force(mode) / stiffness[mode] for mode in (0, 1)]
    by_rate = [device.left[mode] + device.right[mode] for mode in (0, 1)]
    answers = [
        device.pick_off[mode]
        * device.force(mode)
        / complex(
            (2 * math.pi) ** 2 * (device.sense_hz[mode] ** 2 - device.drive_hz**2),
            (2 * math.pi) ** 2 * device.sense_hz[mode] * device.drive_hz / device.q[mode],
        )
        for mode in (0, 1)
    ]
    return Gyroscope(
        drive_hz=device.drive_hz,
        split_hz=device.drive_hz - device.sense_hz[1],
        q_anti_phase=device.q[1],
        in_phase_split_hz=device.drive_hz - device.sense_hz[0],
        q_in_phase=device.q[0],
        in_phase_share=part[0] / (part[0] + part[1]),
        carrier_phase_deg=math.degrees(device.carrier_rad - math.pi),
        demodulator_phase_deg=math.degrees(device.demodulator_rad - math.pi),
        comb_mismatch=device.force(0) / by_rate[0] / (device.force(1) / by_rate[1]) - 1.0,
        v_vc_feedthrough=device.through / abs(sum(answers)),
        drive_amplitude_v=device.drive_m,
        carrier_amplitude_v=device.carrier_v,
    )


def aged(device: Device, what: str) -> Device:
    """Return what has become of a device."""
    if what.startswith("Q"):
        factor = float(what.split()[1])
        return replace(device, q=(device.q[0] * factor, device.q[1] * factor))
    if what == "split":
        return replace(device, sense_hz=(device.sense_hz[0], device.sense_hz[1] + 0.5))
    changed = tuple(each * (1.0 - 31e-6) for each in device.sense_hz)
    q = tuple(each * (1.0 - 2e-3) for each in device.q)
    return replace(device, drive_hz=device.drive_hz * (1.0 - 30e-6), sense_hz=changed, q=q)  # type: ignore[arg-type]


def changed(after: Device) -> Mapping[str, float]:
    """Return what would be measured of `after`; shares and feed-through are held."""
    held = ("in_phase_share", "comb_mismatch", "v_vc_feedthrough")
    return {name: value for name, value in structs.asdict(measured(after)).items() if name not in held}


DEVICES = {
    "as shipped": Device(),
    "carrier exactly pi": Device(carrier_rad=math.pi),
    "combs equal": Device(combs=(1.0, 1.0)),
    "both": Device(combs=(1.0, 1.0), carrier_rad=math.pi),
    "carrier 1 deg off": Device(carrier_rad=math.pi + math.radians(1.0)),
    "carrier 3 deg off": Device(carrier_rad=math.pi + math.radians(3.0)),
}
AGEING = ("Q 0.5", "Q 0.8", "Q 0.9", "Q 1.1", "split", "1 K")
SEEN_PPM = {  # found on the simulated bench, by a rate and a V_Vc of the same output; the output stage adds up to 1.5
    "as shipped": (-254.0, -64.0, -28.0, 23.0, -22.0, 29.6),
    "carrier exactly pi": (9.0, 2.0, 1.0, -1.0, -16.0, 30.1),
    "combs equal": (-262.0, -66.0, -29.0, 24.0, -7.0, 29.5),
    "both": (1.0, 0.0, 0.0, 0.0, -1.0, 30.0),
    "carrier 1 deg off": (-868.0, -218.0, -97.0, 79.0, -36.0, 28.5),
    "carrier 3 deg off": (-2629.0, -658.0, -293.0, 240.0, -76.0, 25.2),
}


@pytest.mark.parametrize("name", DEVICES)
def test_changes_are_those_that_the_whole_bench_shows(name: str) -> None:
    """Q, split and temperature, by what procedures measure of the device, to what else the bench has in it."""
    device = DEVICES[name]
    found = [change_ppm(measured(device), changed(aged(device, what))) for what in AGEING]
    assert found == pytest.approx(SEEN_PPM[name], abs=2.0)


RICH = Device(
    q=(900.0, 1500.0), left=(0.75, 0.45), right=(0.3, 0.55), pick_off=(0.9, 1.1), combs=(1.02, 0.97), through=4e-11
)


@pytest.mark.parametrize(
    "after",
    [
        aged(RICH, "Q 0.5"),
        replace(RICH, carrier_rad=RICH.carrier_rad + 0.05, demodulator_rad=RICH.demodulator_rad - 0.05),
        replace(RICH, sense_hz=(3330.0, 3467.0), drive_m=1.02, carrier_v=0.99, through=-2e-11, drive_hz=3485.0),
        replace(RICH, pick_off=(0.95, 1.0), combs=(1.02, 1.02)),
    ],
    ids=["Q", "phases", "frequencies, amplitudes, feed-through", "pick-offs and combs"],
)
def test_a_change_is_that_of_the_equations_of_motion(after: Device) -> None:
    """However large, with everything at once that is in them."""
    true = k_vc(after) / k_vc(RICH) * RICH.force(1) / after.force(1)  # the anti-phase combs are what nobody sees
    now = structs.asdict(measured(after))
    if RICH.pick_off == after.pick_off and RICH.combs == after.combs:
        now = {name: now[name] for name in now if name not in {"in_phase_share", "comb_mismatch"}}
        if RICH.through == after.through:
            del now["v_vc_feedthrough"]
    assert change_ppm(measured(RICH), now) == pytest.approx(1e6 * (true - 1.0), abs=1e-3)


def test_sensitivities_are_the_derivatives_of_the_change() -> None:
    """By each quantity, at a device with everything in it."""
    device = measured(RICH)
    found = sensitivities(device)
    assert set(found) == set(QUANTITIES)
    for name, value in found.items():
        at = getattr(device, name)
        step = 1e-4 * max(abs(at), 1e-2)
        moved = [change_ppm(device, {name: at + sign * step}) for sign in (1.0, -1.0)]
        assert (moved[0] - moved[1]) / (2.0 * step) == pytest.approx(value, rel=1e-5), name
