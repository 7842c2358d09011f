"""Rate response of an open-loop gyroscope: the closed form through the tones of sampled sines.

It has both side bands of both sense modes; what is not known of the gyroscope is free: share and place of the in-phase
mode, phase of the demodulator.
"""

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import ModelFit, fit_model, not_negative, propagated
from vcfbench.analysis.tone import BINS, HARMONICS, Tone
from vcfbench.errors import ConfigError
from vcfbench.values.quantile import chi_square_tail

_CLOSE_HZ = 1e-10
_NOISE_TO_HZ = 500.0
"""Beyond it no noise passes the filter of a gyroscope of some 100 Hz."""
_ROUNDING = 1e-12
"""Relative rounding error of an amplitude without noise."""
_LEAST_THIRD = 1e-9
"""Relative u of a third harmonic, at least: what is less is rounding, which weights must not follow."""
_LEAST_U = 5.0
"""An amplitude of less than so many times its uncertainty is mostly noise, which has no sign there."""
_FEW, _NOISE_ROUNDS = 3, 12
_SEEN, _TELLS = 3.0, 9.0
"""The in-phase mode is seen by so many uncertainties of its part, a side of the drive by so much of chi-square."""
_BY_CHANCE = 0.05
"""Probability of a chi-square above which no more than noise need be off the closed form."""
_LEAST_SHARE = 0.03
"""Least amplitude, relative to that at the lowest frequency. A smaller one lies in the dip where the modes cancel: its
dependence on their shares is so far from linear that no fit ends there."""


class Known(Struct, frozen=True):
    """Parameters of a gyroscope known before its response is fitted."""

    drive_hz: float
    in_phase_split_hz: float = 147.0
    """Drive less in-phase sense frequency."""
    u_in_phase_split_hz: float = 30.0
    u_phase_rad: float = 0.1
    """Standard uncertainty of the demodulator's phase against the force."""
    low_pass_hz: float = 100.0
    low_pass_order: int = 4
    """Order of the Butterworth filter behind the demodulator; it is divided out."""
    off_form: float = 0.0
    """Standard uncertainty of each gain, over it, for what the closed form lacks of the chain."""


class RateBand(Struct, frozen=True):
    """A fitted response. A pair is a value and its standard uncertainty, that of the noise alone."""

    split_hz: tuple[float, float]
    q: tuple[float, float]
    static_gain: float
    plus_3_db_hz: tuple[float, float]
    peak_hz: tuple[float, float]
    peak_gain: tuple[float, float]
    """Over the static gain."""
    minus_3_db_hz: tuple[float, float]
    in_phase_share: tuple[float, float]
    """Part of the in-phase mode in the static gain."""
    parameters: Floats
    frequency_hz: Floats
    gain: Floats
    u_gain: Floats
    residual: Floats
    """Measured over fitted gain, less 1."""
    chi_square: float
    dof: int
    noise_dof: float


def foreseen_tone(
    frequency_hz: float,
    record: tuple[int, float, float],
    static_and_white: tuple[float, float],
    known: Known,
    shape: Sequence[float],
) -> Tone:
    """Return the tone that a record will show.

    Args:
        frequency_hz: of the sine.
        record: samples, their spacing and aperture (s).
        static_and_white: amplitude at rest, and the random walk of the integrated output (1 sqrt(s) of it).
        known: of the gyroscope: its drive and its filter.
        shape: as the parameters of :func:`split_response`.
    """
    (samples, spacing_s, aperture_s), (static, white) = record, static_and_white
    parameters = np.array(shape)
    width_hz = 1.0 / (samples * spacing_s)
    reach = math.ceil(_NOISE_TO_HZ * spacing_s)
    at_rest = _passed(np.zeros(1), parameters, known)

    def noise(at_hz: float) -> tuple[float, Floats]:
        """Return u of an amplitude, and the lines beside it, Hz."""
        beside = abs(math.remainder(at_hz, 1.0 / spacing_s)) + width_hz * np.array(
            [s * n for n in BINS for s in (-1, 1)]
        )
        beside = beside[(beside > 1.5 * width_hz) & (beside < 0.5 / spacing_s - width_hz)]
        folded = beside[:, None] + np.arange(-reach, reach + 1) / spacing_s
        passed = _passed(folded, parameters, known) / at_rest
        density = np.sum(passed * (_filter_gain(folded, known) * np.sinc(folded * aperture_s)) ** 2, axis=1)
        variance = 2.0 * white**2 * float(density.mean()) * width_hz
        return math.hypot(math.sqrt(variance), _ROUNDING * static), beside

    u_amplitude, beside = noise(frequency_hz)
    once, thrice = (abs(float(np.sinc(order * frequency_hz * aperture_s))) for order in (1, HARMONICS))
    gain = float(split_response(frequency_hz, known.drive_hz, parameters)[0]) * float(_filter_gain(frequency_hz, known))
    return Tone(
        frequency_hz=frequency_hz,
        amplitude=static * gain,
        u_amplitude=u_amplitude / once,
        third=0.0,
        spacing_s=spacing_s,
        noise_dof=2.0 * beside.size,
        noise_hz=tuple(beside.tolist()),
        u_third=noise(HARMONICS * frequency_hz)[0] / thrice,
    )


def _filter_gain(f: ArrayLike, known: Known) -> Floats:
    ratio = np.asarray(f, dtype=np.float64) / known.low_pass_hz
    return np.asarray(1.0 / np.sqrt(1.0 + ratio ** (2 * known.low_pass_order)))


def split_guess_hz(frequency_hz: ArrayLike, gain: ArrayLike, low_pass: tuple[float, int] | None = None) -> float:
    """Return about where the response peaks, from gains at a few frequencies far apart.

    Args:
        frequency_hz: of the sines.
        gain: there, in any unit.
        low_pass: corner, Hz, and order of the filter behind the demodulator, which is divided out; None: it is not.

    Raises:
        ConfigError: fewer than four gains, or one that is not positive.
    """
    f, level = np.asarray(frequency_hz, dtype=np.float64), np.asarray(gain, dtype=np.float64)
    if f.size < 4 or not (level > 0.0).all():
        raise ConfigError(f"the split cannot be guessed from {f.size} gains; four positive ones are needed")
    if low_pass is not None:
        level = level / _filter_gain(f, Known(0.0, low_pass_hz=low_pass[0], low_pass_order=low_pass[1]))
    tried = np.geomspace(max(float(f.min()), 1e-3), float(f.max()), 2000)
    ratio = f[None, :] / tried[:, None]
    shape = -0.5 * np.log((1.0 - ratio**2) ** 2 + (0.1 * ratio) ** 2)
    left = np.log(level)[None, :] - shape
    return float(tried[np.var(left, axis=1).argmin()])


def split_response(frequency_hz: ArrayLike, drive_hz: float, parameters: Floats | Sequence[float]) -> Floats:
    """Return |H(f)| / |H(0)| for split (Hz), Q, force and pick-off of the in-phase mode over the other, its split, lag.

    Parameters (5,) or (sets, 5) give gains (frequencies,) or (sets, frequencies). Both side bands of the carrier
    through both modes, demodulated with a phase of `lag` (rad) against the force.
    """
    f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    size = np.abs(_transfer(np.append(f, 0.0), drive_hz, parameters))
    return np.asarray(size[..., :-1] / size[..., -1:])


def _transfer(at: Floats, drive_hz: float, parameters: Floats | Sequence[float]) -> NDArray[np.complex128]:
    split, q, share, in_phase_split, lag = np.asarray(parameters).T[..., None]
    side = np.stack([drive_hz + at, at - drive_hz]).reshape(2, *(1,) * (lag.ndim - 1), -1)
    turn = np.exp(1j * np.stack([-lag, lag]))
    total: NDArray[np.complex128] = np.zeros(1, dtype=np.complex128)
    for part, own in ((1.0, drive_hz - split), (share, drive_hz - in_phase_split)):
        upper, lower = part * turn / (own**2 - side**2 + 1j * side * own / q)
        total = total + upper + lower
    return total


def response_phase_deg(frequency_hz: float, known: Known, parameters: Floats) -> float:
    """Return the phase of the response against that at rest, deg, with its Butterworth filter, within half a turn.

    `parameters` are those of :func:`split_response`.
    """
    return float(np.degrees(np.angle(_filtered(np.array([frequency_hz]), known, parameters)[0])))


def _filtered(f: Floats, known: Known, shape: Floats) -> NDArray[np.complex128]:
    """Return H(f) / H(0) with its Butterworth filter."""
    passed, at_rest = (_transfer(at, known.drive_hz, shape) for at in (f, np.zeros(1)))
    order = known.low_pass_order
    poles = np.exp(1j * math.pi * (2.0 * np.arange(order) + order + 1.0) / (2.0 * order))
    through = np.prod(-poles / (1j * f[:, None] / known.low_pass_hz - poles), axis=1)
    return np.asarray(passed / at_rest * through)


def _straightened(tones: Sequence[Tone], known: Known, shape: Floats) -> tuple[Floats, Floats]:
    """Return the amplitudes without the compression of the output stage, which the third harmonics tell, and its u.

    A cube of the output makes three times as much of the fundamental as of the third harmonic. The modulator makes a
    third harmonic too, the same at all frequencies, that passes through the modes: with the `shape` of the response it
    is told from the other. The u, (tones,), are of one error: that of the cube.
    """
    f, level, third, u = np.array([(each.frequency_hz, each.amplitude, each.third, each.u_third) for each in tones]).T
    one, three = (_filtered(order * f, known, shape) for order in (1.0, 3.0))
    weight = 1.0 / np.maximum(u, _LEAST_THIRD * level)
    columns = np.column_stack([level**3, (three * (one.conj() / np.abs(one)) ** 3).real]) * weight[:, None]
    size = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / size)
    cube = float(inverse[0] @ (third * weight)) / size[0]
    u_cube = float(np.linalg.norm(inverse[0])) / size[0]
    return level * (1.0 - 3.0 * cube * level**2), 3.0 * u_cube * level**3


def fit_rate_band(tones: Sequence[Tone], amplitude: float, known: Known) -> RateBand:
    """Fit the closed form to tones that one amplitude at the input gave.

    The output stage's compression is read from the third harmonics and taken out; by how much it is off then is fitted
    too, in its u. The noise of each tone is that of all tones with the same spacing of samples: part of it is flat,
    part passes through the modes as the response does.

    A response shows how wide its peak is; the quality factor, which is the mode's frequency over that, differs by twice
    the split over the drive frequency between a mode below the drive and one above. On which side it is, the in-phase
    mode tells, which is below the drive and seen with the same sign; where that is too weak, u of q and of the split
    hold either.

    Raises:
        ConfigError: fewer than ten tones, or no peak among them.
    """
    floor = _LEAST_SHARE * min(tones, key=lambda tone: tone.frequency_hz).amplitude if tones else 0.0
    seen = [tone for tone in tones if tone.alone and tone.amplitude > max(floor, _LEAST_U * tone.u_amplitude)]
    ordered = sorted(seen, key=lambda tone: tone.frequency_hz)
    if len(ordered) < 10:
        raise ConfigError(f"a response needs at least ten frequencies, got {len(ordered)}")
    f = np.array([tone.frequency_hz for tone in ordered])
    filter_gain = _filter_gain(f, known)
    scale = filter_gain * amplitude
    level = np.array([tone.amplitude for tone in ordered]) / scale
    place = int(level.argmax())
    q = max(1.0, float(level[place] / level[0])) * known.drive_hz / f[place]
    u = np.array([tone.u_amplitude for tone in ordered]) / scale
    u = np.hypot(np.maximum(u, float(np.median(u / level)) * level), known.off_form * level)

    unknown = 0.8, known.in_phase_split_hz, 0.0, 0.0

    def of_form(start: Floats, u: Floats) -> tuple[ModelFit, Floats]:
        """Fit from a start whose shape tells the compression; return the gains without that, too."""
        gain, bent = (each / scale for each in _straightened(ordered, known, _shape(start)))
        fit = fit_model(lambda p: _residuals(p, f, (gain, bent, u), known), start, "bandwidth")
        return fit, gain - fit.parameters[-1] * bent

    def least(start: Floats, u: Floats) -> ModelFit:
        """Return the better of two fits, because a start far off can end at a wrong minimum with a false lag."""
        first, _ = of_form(start, u)
        again, _ = of_form(np.array([*first.parameters[:3], *unknown]), u)
        return min(first, again, key=lambda fit: fit.chi_square)

    def without_lag(fit: ModelFit) -> Floats:
        """Return a start without a lag near 0, because its scale and slope would be rounding errors."""
        return np.array([*fit.parameters[:5], 0.0, 0.0])

    def fitted(side: float, u: Floats) -> tuple[ModelFit, Floats]:
        start = np.array([side * f[place], q, level[0], *unknown])
        for _ in range(2):
            fit = least(start, u)
            start = without_lag(fit)
            u = np.hypot(_smooth_u(ordered, fit.parameters, known) / scale, known.off_form * level)
        return least(start, u), u

    sides: list[tuple[ModelFit, Floats]] = []
    for side in (1.0, -1.0):
        with suppress(ConfigError):
            sides.append(fitted(side, u))
    if not sides:
        raise ConfigError("bandwidth: the points do not determine the model")
    best, *others = sorted(sides, key=lambda each: (each[0].parameters[3] < 0.0, each[0].chi_square))
    either = any(o.parameters[3] > 0.0 and o.chi_square < best[0].chi_square + _TELLS for o, _ in others)
    fit, gain = of_form(without_lag(best[0]), best[1])
    dof = sum(tone.noise_dof for tone in ordered)
    return _band(fit, known.drive_hz, f, gain, best[1], noise_dof=dof, either_side=either)


def _shape(parameters: Floats) -> Floats:
    return parameters[..., [0, 1, 3, 4, 5]]


def _residuals(parameters: Floats, f: Floats, seen: tuple[Floats, Floats, Floats], known: Known) -> Floats:
    gain, bent, u = seen
    model = parameters[..., 2:3] * split_response(f, known.drive_hz, _shape(parameters))
    place = (parameters[..., 4:5] - known.in_phase_split_hz) / known.u_in_phase_split_hz
    off = parameters[..., 6:7]
    return np.concatenate(
        [(model - gain + off * bent) / u, place, parameters[..., 5:6] / known.u_phase_rad, off], axis=-1
    )


def _smooth_u(tones: Sequence[Tone], parameters: Floats, known: Known) -> Floats:
    """Return the uncertainty of each amplitude: the noise of all tones of one spacing, flat, by the modes, and flicker.

    It was read beside each tone and counts at the tone: near the peak these are not the same.
    """
    at, shape = [np.array([tone.frequency_hz]) for tone in tones], _shape(parameters)
    lines = [np.array(tone.noise_hz) if tone.noise_hz else own for tone, own in zip(tones, at, strict=True)]
    here, beside = (
        np.array([[1.0, float(_passed(f, shape, known).mean()), float(np.mean(1.0 / f))] for f in each])
        for each in (at, lines)
    )
    scale = here.min(axis=0)
    here, beside = here / scale, beside / scale
    variance = np.array([tone.u_amplitude**2 for tone in tones])
    weight = np.sqrt([tone.noise_dof for tone in tones])
    group = np.array([round(tone.spacing_s * 1e3) for tone in tones])
    smooth = np.empty_like(variance)
    for each in np.unique(group):
        of = group == each
        model = np.full(int(of.sum()), float(np.mean(variance[of])))
        if few := model.size <= _FEW:
            smooth[of] = model
        for _ in range(0 if few else _NOISE_ROUNDS):
            rows = weight[of] / model
            found = not_negative(beside[of] * rows[:, None], variance[of] * rows)
            # halfway, by factors: one tone of more noise than the model has would make the weights swing
            model, smooth[of] = np.sqrt(model * (beside[of] @ found)), here[of] @ found
    return np.asarray(np.sqrt(smooth))


def _passed(f: Floats, shape: Floats, known: Known) -> Floats:
    """Return the power of both modes' response to a white force noise, both side bands by themselves, in any unit."""
    split, q, share, in_phase_split, _ = shape
    modes = ((1.0, known.drive_hz - split), (share, known.drive_hz - in_phase_split))
    sides = [
        sum(part / (own**2 - side**2 + 1j * side * own / q) for part, own in modes)
        for side in (known.drive_hz + f, f - known.drive_hz)
    ]
    return np.asarray(np.abs(sides[0]) ** 2 + np.abs(sides[1]) ** 2)


def _band(
    fit: ModelFit, drive_hz: float, f: Floats, gain: Floats, u: Floats, *, noise_dof: float, either_side: bool
) -> RateBand:
    def points(parameters: Floats) -> Floats:
        return _points(drive_hz, parameters)

    model = fit.parameters[2] * split_response(f, drive_hz, _shape(fit.parameters))
    dof = f.size + 3 - fit.parameters.size
    if chi_square_tail(fit.chi_square, dof) < _BY_CHANCE:  # as uncertain as they lie off the form (Birge 1932)
        fit = replace(fit, covariance=fit.chi_square / dof * fit.covariance)
    split, q, _, in_phase, *_ = zip(fit.parameters.tolist(), np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)
    if either_side or in_phase[0] < _SEEN * in_phase[1]:
        q = q[0], math.hypot(q[1], 2.0 * abs(split[0]) / drive_hz * q[0] / math.sqrt(3.0))
        # A peak is f / (4 Q^2) beside its mode, of one side above and of the other below
        split = split[0], math.hypot(split[1], 0.5 * drive_hz / q[0] ** 2 / math.sqrt(3.0))
    found = zip(points(fit.parameters).tolist(), propagated(points, fit).tolist(), strict=True)
    plus_3_db, peak, peak_gain, minus_3_db, share = found
    return RateBand(
        split_hz=(abs(split[0]), split[1]),
        q=q,
        static_gain=float(fit.parameters[2]),
        plus_3_db_hz=plus_3_db,
        peak_hz=peak,
        peak_gain=peak_gain,
        minus_3_db_hz=minus_3_db,
        in_phase_share=share,
        parameters=fit.parameters[:6],
        frequency_hz=f,
        gain=gain,
        u_gain=u,
        residual=gain / model - 1.0,
        chi_square=fit.chi_square,
        dof=dof,
        noise_dof=noise_dof,
    )


def _points(drive_hz: float, parameters: Floats) -> Floats:
    """Return the points of the relative gain: +3 dB (Hz), peak (Hz) and its gain, -3 dB (Hz); and the in-phase share.

    That is of the static gain, by the stiffness that each mode has at the drive frequency.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - SciPy costs more to import than all the rest

    shape = _shape(parameters)
    split = float(shape[0])

    def gain(at_hz: float) -> float:
        return float(split_response(at_hz, drive_hz, shape)[0])

    size = abs(split)
    near = 1e-4 * size
    try:
        peak = brentq(lambda at: gain(at + near) - gain(at - near), 0.5 * size, 1.5 * size, xtol=_CLOSE_HZ)
        plus_3_db = brentq(lambda at: gain(at) - math.sqrt(2.0), 0.0, peak, xtol=_CLOSE_HZ)
        # The first one above the peak: the other mode may raise the gain again
        steps = peak + 0.05 * peak * np.arange(1, 100)
        below = split_response(steps, drive_hz, shape) < math.sqrt(0.5)
        minus_3_db = brentq(lambda at: gain(at) - math.sqrt(0.5), peak, steps[below.argmax()], xtol=_CLOSE_HZ)
    except ValueError:
        raise ConfigError(
            "bandwidth: the fitted response has no peak, or never passes half of its static power"
        ) from None
    near_stiffness, far_stiffness = ((drive_hz - each) ** 2 - drive_hz**2 for each in (split, parameters[4]))
    far = parameters[3] / far_stiffness
    return np.array([plus_3_db, peak, gain(peak), minus_3_db, far / (far + 1.0 / near_stiffness)])
