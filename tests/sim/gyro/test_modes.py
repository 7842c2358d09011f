from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vcfbench.sim.gyro.modes import Resonance, butterworth_poles, butterworth_residues

DRIVE = Resonance(2 * math.pi * 3488.9, 1395.0)
SENSE = (Resonance(2 * math.pi * 3342.0, 1224.0), Resonance(2 * math.pi * 3464.1, 1224.0))
OMEGA = 2 * math.pi * 3488.9
TIMES = np.linspace(0.0, 0.3, 4001)


def forced_from_rest(mode: Resonance, force: complex, omega: float) -> np.ndarray:
    parts = [mode.step((0j, 0j), force, omega, float(t)) for t in TIMES]
    return np.array(
        [(mode.displacement(p) * cmath.exp(1j * omega * t)).real for p, t in zip(parts, TIMES, strict=True)]
    )


def equation_2(mode: Resonance, force: float, omega: float) -> np.ndarray:
    """x(t) for F_d sin(w_d t), equation (2); erratum: the sine term holds w^2/(2 Q^2) + w_d^2 - w^2, not w^2/Q + ..."""
    w, q = mode.natural_rad_s, mode.quality
    d = (w**2 - omega**2) ** 2 + (w * omega / q) ** 2
    phi = math.atan2(-w * omega / q, w**2 - omega**2)
    ringing = math.sqrt(1 - 1 / (4 * q**2)) * w
    decay = np.exp(-w / (2 * q) * TIMES)
    return (
        force / math.sqrt(d) * np.sin(omega * TIMES + phi)
        + force * w * omega / q / d * decay * np.cos(ringing * TIMES)
        + force * omega * (w**2 / (2 * q**2) + omega**2 - w**2) / (ringing * d) * decay * np.sin(ringing * TIMES)
    )


def equation_3(mode: Resonance, force: float, omega: float, phi_x: float) -> np.ndarray:
    """y(t) for F_c sin(w_d t + phi_x + pi/2), equation (3).

    Errata: the sine term is -w (w^2 + w_d^2) cos(phi)/2Q + w_d (w^2 - w_d^2 - w^2/2Q^2) sin(phi); phi_y by atan2.
    """
    w, q = mode.natural_rad_s, mode.quality
    d = (w**2 - omega**2) ** 2 + (w * omega / q) ** 2
    phi_y = math.atan2(-w * omega / q, w**2 - omega**2)
    ringing = math.sqrt(1 - 1 / (4 * q**2)) * w
    decay = np.exp(-w / (2 * q) * TIMES)
    cosine = w * omega * math.sin(phi_x) / q + (w**2 - omega**2) * math.cos(phi_x)
    sine = -w * (w**2 + omega**2) * math.cos(phi_x) / (2 * q)
    sine += omega * (w**2 - omega**2 - w**2 / (2 * q**2)) * math.sin(phi_x)
    return (
        force / math.sqrt(d) * np.sin(omega * TIMES + phi_x + math.pi / 2 + phi_y)
        - force * cosine / d * decay * np.cos(ringing * TIMES)
        + force * sine / (ringing * d) * decay * np.sin(ringing * TIMES)
    )


@pytest.mark.parametrize("detuning_hz", [0.0, 3.0, -40.0])
def test_drive_from_rest_follows_equation_2_within_1e_9(detuning_hz: float) -> None:
    omega = OMEGA + 2 * math.pi * detuning_hz
    seen, wanted = forced_from_rest(DRIVE, -1j, omega), equation_2(DRIVE, 1.0, omega)
    assert np.max(np.abs(seen - wanted)) < 1e-9 * np.max(np.abs(wanted))


@pytest.mark.parametrize("mode", SENSE)
@pytest.mark.parametrize("phi_x", [-math.pi / 2, -0.3])
def test_sense_modes_from_rest_follow_corrected_equation_3(mode: Resonance, phi_x: float) -> None:
    seen, wanted = forced_from_rest(mode, cmath.exp(1j * phi_x), OMEGA), equation_3(mode, 1.0, OMEGA, phi_x)
    assert np.max(np.abs(seen - wanted)) < 1e-9 * np.max(np.abs(wanted))


def test_corrected_equations_solve_equation_of_motion() -> None:
    w, q, end = DRIVE.natural_rad_s, DRIVE.quality, 0.02
    omega = OMEGA + 60.0
    inside = TIMES[end >= TIMES]
    solved = solve_ivp(
        lambda t, s: [s[1], math.sin(omega * t) - w / q * s[1] - w * w * s[0]],
        (0.0, end), [0.0, 0.0], "DOP853", t_eval=inside, rtol=1e-11, atol=1e-18,
    )  # fmt: skip
    wanted = equation_2(DRIVE, 1.0, omega)[: len(inside)]
    assert np.max(np.abs(solved.y[0] - wanted)) < 1e-8 * np.max(np.abs(wanted))


@pytest.mark.parametrize("mode", [DRIVE, *SENSE])
def test_ring_down_recovers_frequency_and_q_within_0_1_percent(mode: Resonance) -> None:
    start = mode.parts(1e-6, 0j)
    x = np.array([mode.displacement(mode.step(start, 0j, 0.0, float(t))).real for t in np.arange(0, 0.05, 1e-5)])
    # Linear prediction of a damped oscillation: x[n+1] = 2 e^-a cos(b) x[n] - e^-2a x[n-1].
    (first, second), *_ = np.linalg.lstsq(np.column_stack((x[1:-1], x[:-2])), x[2:], rcond=None)
    damping = -math.log(-second) / 2
    ringing = math.acos(first / (2 * math.exp(-damping)))
    natural = math.hypot(damping, ringing) / 1e-5
    assert natural == pytest.approx(mode.natural_rad_s, rel=1e-3)
    assert natural / (2 * damping / 1e-5) == pytest.approx(mode.quality, rel=1e-3)


amplitudes = st.complex_numbers(max_magnitude=1.0, allow_nan=False, allow_infinity=False)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(1e-5, 0.5))
def test_a_free_mode_only_loses_energy(y: float, dy: float, duration: float) -> None:
    mode = SENSE[1]
    start = mode.parts(y, dy * mode.natural_rad_s)
    frame = OMEGA

    def energy(parts: tuple[complex, complex], t: float) -> float:
        turn = cmath.exp(1j * frame * t)
        position, speed = (mode.displacement(parts) * turn).real, (mode.velocity(parts) * turn).real
        return speed**2 + (mode.natural_rad_s * position) ** 2

    before = energy(start, 0.0)
    assert energy(mode.step(start, 0j, frame, duration), duration) <= before * (1 + 1e-9) + 1e-9


@given(amplitudes, amplitudes, amplitudes, st.floats(1e-6, 0.3))
def test_parts_and_motion_agree_and_force_reversal_mirrors_them(
    y: complex, dy: complex, force: complex, duration: float
) -> None:
    mode = SENSE[0]
    parts = mode.parts(y, dy)
    assert cmath.isclose(mode.displacement(parts), y, rel_tol=1e-9, abs_tol=1e-12)
    assert cmath.isclose(mode.velocity(parts), dy, rel_tol=1e-9, abs_tol=1e-6)
    there = mode.step(parts, force, OMEGA, duration)
    mirrored = mode.step((-parts[0], -parts[1]), -force, OMEGA, duration)
    assert (-mirrored[0], -mirrored[1]) == there


@pytest.mark.parametrize("order", [1, 2, 4])
def test_butterworth_is_flat_with_3_db_at_cut_off(order: int) -> None:
    poles = butterworth_poles(2.0, order)
    residues = butterworth_residues(poles)
    for frequency in (0.1, 1.0, 2.0, 7.0):
        gain = abs(sum(r / (1j * frequency - p) for r, p in zip(residues, poles, strict=True)))
        assert gain == pytest.approx(1 / math.sqrt(1 + (frequency / 2.0) ** (2 * order)), rel=1e-12)
