"""The warm gyroscope written down once more, from the signal equation in docs/theory.md alone, in plain numbers.

`Gyroscope` has its output at rest and at a rate in closed form, by the names that `vcfbench sim show` prints.
`integrated_v` is the same by integrating the equations of motion at carrier level, from rest until the modes are
steady, with the product of the demodulator averaged over whole periods. The filter passes a mean as it is, and what it
leaves of twice the carrier is 4e-8 of it, so it is in neither.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

if TYPE_CHECKING:
    from numpy.typing import NDArray

Parameters: TypeAlias = Mapping[str, Mapping[str, Any]]

EARTH_DEG_S = 15.041067 / 3600.0
MODES = ("sense_in_phase", "sense_anti_phase")
SAMPLES = 64
"""Of a period of the carrier; what is averaged has lines at 0 and twice the carrier alone."""


@dataclass(frozen=True)
class Mode:
    """A sense mode at its temperature: rad/s, quality, V/m, share of the Coriolis force, comb force, quadrature."""

    natural: float
    quality: float
    pick_off: float
    share: float
    combs: float
    quadrature: float


@dataclass(frozen=True)
class Gyroscope:
    """A gyroscope as it is after its warm-up, on rails of `rail_v` (the weaker one, V)."""

    parameters: Parameters
    rail_v: float = 10.0

    @property
    def above_reference_k(self) -> float:
        """How far its temperature is from that at which its parameters hold, K."""
        thermal = self.parameters["thermal"]
        return float(thermal["ambient_c"] + thermal["self_heating_k"] - thermal["reference_c"])

    @property
    def carrier_rad_s(self) -> float:
        """Where the drive is locked: its own resonance."""
        drive = self.parameters["drive_mode"]
        return float(math.tau * drive["frequency_hz"] * (1 + drive["frequency_coefficient_per_k"] * self._k))

    @property
    def _k(self) -> float:
        return self.above_reference_k

    @property
    def _growth(self) -> float:
        """How much larger the drive moves than on nominal rails; the carrier follows."""
        nominal_v = self.parameters["supply"]["nominal_v"]
        return float(
            1 + self.parameters["drive_loop"]["amplitude_supply_coefficient_per_v"] * (self.rail_v - nominal_v)
        )

    @property
    def amplitude_m(self) -> float:
        """Of the drive."""
        return float(self.parameters["drive_loop"]["amplitude_m"] * self._growth)

    @property
    def carrier_v(self) -> float:
        """Of the carrier and of the demodulator's reference."""
        return float(self.parameters["sense_path"]["reference_amplitude_v"] * self._growth)

    def modes(self) -> list[Mode]:
        """Return both sense modes at this temperature."""
        path, found = self.parameters["virtual_path"], []
        for name in MODES:
            mode = self.parameters[name]
            left, right = mode["left_participation"], mode["right_participation"]
            found.append(
                Mode(
                    natural=math.tau * mode["frequency_hz"] * (1 + mode["frequency_coefficient_per_k"] * self._k),
                    quality=mode["quality"] * (1 + mode["quality_coefficient_per_k"] * self._k),
                    pick_off=mode["pick_off_v_per_m"],
                    share=left + right,
                    combs=left * path["left_comb_n_per_v2"] + right * path["right_comb_n_per_v2"],
                    quadrature=mode["quadrature_rad_s"],
                )
            )
        return found

    def rate_rad_s(self, table_deg_s: float) -> float:
        """Return the rate that acts, by that of the table."""
        site, thermal, table = (self.parameters[name] for name in ("site", "thermal", "table"))
        about_axis = table_deg_s + EARTH_DEG_S * math.sin(math.radians(site["latitude_deg"]))
        askew = math.cos(math.radians(table["misalignment_deg"]))
        return math.radians(about_axis * askew + thermal["bias_coefficient_deg_s_k"] * self._k)

    def modulated_v(self, v_vc_v: float | None) -> float:
        """Return what the modulator makes of the voltage on its input, V; None is an open switch."""
        path = self.parameters["virtual_path"]
        if v_vc_v is None:
            return 0.0
        curved = path["second_order_per_v"] * v_vc_v**2 + path["third_order_per_v2"] * v_vc_v**3
        return float(path["offset_v"] + v_vc_v + curved)

    def leaked_v(self, m: float) -> float:
        """Return the amplitude of what is in V_s without any motion, on the carrier, V."""
        path = self.parameters["sense_path"]
        share = path["carrier_feedthrough"] + path["v_vc_feedthrough"] * m / path["reference_amplitude_v"]
        return float(share * self.carrier_v)

    def filtered_v(self, table_deg_s: float, v_vc_v: float | None = None) -> float:
        """Return the filtered volts in closed form."""
        path, virtual = self.parameters["sense_path"], self.parameters["virtual_path"]
        phi, carrier, drive = path["demodulator_phase_rad"], virtual["carrier_phase_rad"], self.carrier_rad_s
        rate, m = self.rate_rad_s(table_deg_s), self.modulated_v(v_vc_v)
        at_reference = math.tau * self.parameters["drive_mode"]["frequency_hz"]
        seen = self.leaked_v(m) * math.cos(carrier - phi)
        for mode in self.modes():
            p, r = mode.natural**2 - drive**2, mode.natural * drive / mode.quality
            forces = (
                (-2.0 * rate * mode.share * self.amplitude_m * drive, 0.0),
                (m * self.carrier_v * mode.combs / virtual["mass_kg"], carrier),
                (2.0 * at_reference * mode.quadrature * self.amplitude_m, math.pi / 2.0),
            )
            gain = path["preamplifier_gain"] * path["amplifier_gain"] * mode.pick_off / (p * p + r * r)
            seen += gain * sum(
                force * (p * math.cos(angle - phi) + r * math.sin(angle - phi)) for force, angle in forces
            )
        return float(0.5 * path["multiplier_per_v"] * self.carrier_v * seen)

    def output_v(self, table_deg_s: float, v_vc_v: float | None = None) -> float:
        """Return what a meter reads that loads nothing, V, by the table's rate and the voltage on the V_Vc input."""
        stage = self.parameters["output_stage"]
        u = stage["gain"] * self.filtered_v(table_deg_s, v_vc_v)
        return float(stage["offset_v"] + u + stage["second_order_per_v"] * u**2 + stage["third_order_per_v2"] * u**3)

    @property
    def scale_factor(self) -> float:
        """Slope of the output at rest, generator off, V/(deg/s)."""
        small = 0.05
        return (self.output_v(small) - self.output_v(-small)) / (2.0 * small)

    @property
    def k_vc(self) -> float:
        """Rate whose output, less that at rest, is that of a small V_Vc, less that at 0 V; (deg/s)/V."""
        small = 1e-3
        per_v = (self.output_v(0.0, small) - self.output_v(0.0, -small)) / (2.0 * small)
        return per_v / self.scale_factor

    def line_slope(self, rates_deg_s: list[float]) -> float:
        """Return the slope of the least-squares line through the outputs at these rates, V/(deg/s)."""
        return float(np.polyfit(rates_deg_s, [self.output_v(rate) for rate in rates_deg_s], 1)[0])


def _motion(gyroscope: Gyroscope, table_deg_s: float, v_vc_v: float | None) -> NDArray[np.float64]:
    """Return the matrix of the equations of motion: x, y1, y2 (in drive amplitudes) and their velocities, sin, cos."""
    parameters, drive = gyroscope.parameters, gyroscope.carrier_rad_s
    virtual, m = parameters["virtual_path"], gyroscope.modulated_v(v_vc_v)
    carrier, rate = virtual["carrier_phase_rad"], gyroscope.rate_rad_s(table_deg_s)
    a = np.zeros((8, 8))
    a[0, 1] = a[2, 3] = a[4, 5] = 1.0
    a[6, 7], a[7, 6] = drive, -drive
    drive_quality = parameters["drive_mode"]["quality"]
    a[1, [0, 1, 6]] = -(drive**2), -drive / drive_quality, drive**2 / drive_quality  # what holds one amplitude
    for row, mode in zip((2, 4), gyroscope.modes(), strict=True):
        push = m * gyroscope.carrier_v * mode.combs / virtual["mass_kg"] / gyroscope.amplitude_m
        a[row + 1, [row, row + 1]] = -(mode.natural**2), -mode.natural / mode.quality
        a[row + 1, 1] = -2.0 * rate * mode.share
        a[row + 1, 0] = -2.0 * math.tau * parameters["drive_mode"]["frequency_hz"] * mode.quadrature
        a[row + 1, [6, 7]] = push * math.cos(carrier), push * math.sin(carrier)
    return a


def _product(gyroscope: Gyroscope, m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return V_s and the demodulator's reference as rows over the state of the motion."""
    path, carrier = gyroscope.parameters["sense_path"], gyroscope.parameters["virtual_path"]["carrier_phase_rad"]
    v_s, reference = np.zeros(8), np.zeros(8)
    amplify = path["preamplifier_gain"] * path["amplifier_gain"] * gyroscope.amplitude_m
    for row, mode in zip((2, 4), gyroscope.modes(), strict=True):
        v_s[row] = amplify * mode.pick_off
    v_s[[6, 7]] = gyroscope.leaked_v(m) * math.cos(carrier), gyroscope.leaked_v(m) * math.sin(carrier)
    phi = path["demodulator_phase_rad"]
    reference[[6, 7]] = math.cos(phi), math.sin(phi)
    return v_s, path["multiplier_per_v"] * gyroscope.carrier_v * reference


def integrated_v(gyroscope: Gyroscope, table_deg_s: float, v_vc_v: float | None = None) -> tuple[float, float]:
    """Return the filtered volts by integration in time: by matrix exponentials, and by a Runge-Kutta of order 8.

    The first starts from rest and runs 65536 periods; the second goes on from there for 40 periods more.
    """
    a = _motion(gyroscope, table_deg_s, v_vc_v)
    v_s, reference = _product(gyroscope, gyroscope.modulated_v(v_vc_v))
    period_s = math.tau / gyroscope.carrier_rad_s
    scale = np.array([1.0, gyroscope.carrier_rad_s] * 3 + [1.0, 1.0])  # velocities in carriers: no large numbers
    a = a * scale / scale[:, None]
    v_s, reference = v_s * scale, reference * scale
    step = expm(a * period_s / SAMPLES)
    state = np.array([0.0] * 6 + [0.0, 1.0])
    state = np.linalg.matrix_power(np.linalg.matrix_power(step, SAMPLES), 65536) @ state
    state[6:] = 0.0, 1.0  # after whole periods; rounding has turned it by 1e-12
    total, at = 0.0, state
    for _ in range(SAMPLES):
        total += float(v_s @ at) * float(reference @ at)
        at = step @ at

    def moving(_time_s: float, now: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.append(a @ now[:8], (v_s @ now[:8]) * (reference @ now[:8]))

    periods = 40
    went = solve_ivp(moving, (0.0, periods * period_s), np.append(state, 0.0), "DOP853", rtol=1e-11, atol=1e-13)
    return total / SAMPLES, float(went.y[8, -1]) / (periods * period_s)
