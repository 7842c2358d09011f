"""Rate response of an open-loop gyroscope from sampled sines: tones in records, and the closed form through them.

Each record holds one sine of known frequency. The meter's own time base is not known well enough, so the spacing of its
samples is found from a strong one. The closed form has both side bands of both sense modes; what is not known of the
gyroscope is free: share and place of the in-phase mode, phase of the demodulator.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import ModelFit, fit_model, not_negative, propagated
from vcfbench.analysis.sine_fit import fit_sine
from vcfbench.errors import ConfigError, MeasurementError

_BINS = range(2, 9)
"""Lines of the spectrum either side of a tone that its noise is read from."""
_FINER, _TINY = 16, 1e-300
"""Lines of a spectrum for each that the record tells apart; power of no line."""
_HARMONICS = 3
_APART = 1.5
"""Lines of the spectrum between sines that a record tells apart."""
_CLOSE_HZ = 1e-10
_TRIES = 100
_NOISE_TO_HZ = 500.0
"""Beyond it no noise passes the filter of a gyroscope of some 100 Hz."""
_ROUNDING = 1e-12
"""Relative rounding error of an amplitude without noise."""
_LEAST_U = 5.0
"""An amplitude of less than so many times its uncertainty is mostly noise, which has no sign there."""
_FEW, _NOISE_ROUNDS = 3, 12
_SEEN, _TELLS = 3.0, 9.0
"""The in-phase mode is seen by so many uncertainties of its part, a side of the drive by so much of chi-square."""
_LEAST_SHARE = 0.03
"""Least amplitude, relative to that at the lowest frequency. A smaller one lies in the dip where the modes cancel: its
dependence on their shares is so far from linear that no fit ends there."""


class Tone(Struct, frozen=True):
    """One sine in a record, the aperture of the samples divided out; amplitudes in the unit of the samples."""

    frequency_hz: float
    amplitude: float
    u_amplitude: float
    """From the noise about this frequency in this record alone."""
    third: float
    """Third harmonic as the cube of the tone has it, with its sign: cos 3 phi where the tone is cos phi."""
    spacing_s: float
    """Spacing of the samples."""
    noise_dof: float
    noise_hz: tuple[float, ...] = ()
    """Lines beside the tone from which the noise was read, Hz; none: the tone's own place."""
    alone: bool = True
    """Whether the spacing of the samples folds no harmonic onto the tone, another one or the mean."""


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


def true_spacing_s(records: Sequence[tuple[float, ArrayLike]], interval_s: float, late_s: float = 1e-3) -> float:
    """Return the interval of the samples, s, from sines of known frequency; at most `late_s` above `interval_s`.

    All records have one spacing, at which most of them have a line that stands above what is beside it: the noise of a
    narrow mode may be the strongest line of each. Where it is so is fitted in the strongest of these sines.

    Raises:
        ConfigError: fewer than 64 samples, a frequency that they do not hold, or no sine there.
    """
    highest_hz, most = max(hz for hz, _ in records), max(np.size(volts) for _, volts in records)
    tried_s = interval_s + np.linspace(0.0, late_s, max(2, math.ceil(late_s * highest_hz * most / 0.2) + 1))
    stands, sizes = np.zeros(tried_s.size), []
    for hz, volts in records:
        values = _checked(volts, interval_s + late_s, hz)
        power = np.abs(np.fft.fft(values - values.mean(), _FINER * values.size)) ** 2
        beside = np.mean([np.roll(power, sign * _FINER * step) for step in _BINS for sign in (-1, 1)], axis=0)
        at = np.rint(hz * tried_s * power.size).astype(int)
        stands += np.log1p(power[at] / (beside[at] + _ROUNDING * power.max() + _TINY))
        sizes.append(hz * np.sqrt(power[at]) / values.size)
    place = int(stands.argmax())
    for each in np.argsort([-size[place] for size in sizes], kind="stable").tolist():
        hz, volts = records[each]
        with suppress(MeasurementError):
            spacing_s = float(fit_sine(volts, 1.0, hz * float(tried_s[place])).frequency_hz / hz)
            if abs(spacing_s - float(tried_s[place])) < late_s:  # else it walked away in the noise of a narrow mode
                return spacing_s
    raise ConfigError(f"no sine of {', '.join(f'{hz:g}' for hz, _ in records)} Hz was found")


def fit_tone(samples: ArrayLike, spacing_s: float, aperture_s: float, frequency_hz: float, *, mains_hz: float) -> Tone:
    """Fit a sine of known frequency, its harmonics and the mains to samples that are `spacing_s` apart.

    Raises:
        ConfigError: fewer than 64 samples, or a frequency that they do not hold.
    """
    values = _checked(samples, spacing_s, frequency_hz)
    cycles = frequency_hz * spacing_s
    steps = np.arange(values.size) - (values.size - 1) / 2.0
    turns = [cycles * order for order in range(1, _HARMONICS + 1)]
    seen_at = sorted(abs(math.remainder(each, 1.0)) for each in (0.0, *turns))
    alone = min(after - before for before, after in pairwise(seen_at)) * values.size > _APART
    turns = turns if alone else turns[:1]
    if abs(frequency_hz - mains_hz) * spacing_s * values.size > 2.0:
        turns.append(mains_hz * spacing_s)
    angle = 2.0 * math.pi * np.outer(steps, turns)
    basis = np.column_stack([np.ones_like(steps), steps / values.size, np.cos(angle), np.sin(angle)])
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    tone, third = (complex(found[2 + n], -found[2 + len(turns) + n]) for n in (0, _HARMONICS - 1 if alone else 0))
    # The variance that noise gives the amplitude, and the lines of the spectrum it is read from
    width = 1.0 / values.size
    places = np.array([turns[0] + sign * step * width for step in _BINS for sign in (-1.0, 1.0)])
    folded = np.abs(np.mod(places + 0.5, 1.0) - 0.5)
    keep = (places > 1.5 * width) & (places < 0.5 - width)
    for other in turns[1:]:
        keep &= np.abs(folded - abs(math.remainder(other, 1.0))) > 1.5 * width
    if not keep.any():
        raise ConfigError("no part of the spectrum about the tone shows the noise alone")
    places = places[keep]
    lines = np.exp(-2j * math.pi * np.outer(places, np.arange(values.size))) @ (values - basis @ found)
    power = float(2.0 / values.size**2 * np.mean(np.abs(lines) ** 2))
    swing = tone / abs(tone)
    return Tone(
        frequency_hz=frequency_hz,
        amplitude=abs(tone) / float(np.sinc(frequency_hz * aperture_s)),
        u_amplitude=math.sqrt(power) / float(np.sinc(frequency_hz * aperture_s)),
        third=alone * (third * swing.conjugate() ** 3).real / float(np.sinc(_HARMONICS * frequency_hz * aperture_s)),
        spacing_s=spacing_s,
        noise_dof=2.0 * places.size,
        noise_hz=tuple((places / spacing_s).tolist()),
        alone=alone,
    )


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
    beside = frequency_hz + width_hz * np.array([sign * step for step in _BINS for sign in (-1, 1)])
    beside = beside[(beside > 1.5 * width_hz) & (beside < 0.5 / spacing_s - width_hz)]
    reach = math.ceil(_NOISE_TO_HZ * spacing_s)
    folded = beside[:, None] + np.arange(-reach, reach + 1) / spacing_s
    passed = _passed(folded, parameters, known) / _passed(np.zeros(1), parameters, known)
    density = np.sum(passed * (_filter_gain(folded, known) * np.sinc(folded * aperture_s)) ** 2, axis=1)
    gain = float(split_response(frequency_hz, known.drive_hz, parameters)[0]) * float(_filter_gain(frequency_hz, known))
    variance = 2.0 * white**2 * float(density.mean()) * width_hz
    return Tone(
        frequency_hz=frequency_hz,
        amplitude=static * gain,
        u_amplitude=math.hypot(math.sqrt(variance), _ROUNDING * static) / float(np.sinc(frequency_hz * aperture_s)),
        third=0.0,
        spacing_s=spacing_s,
        noise_dof=2.0 * beside.size,
        noise_hz=tuple(beside.tolist()),
    )


def _filter_gain(f: ArrayLike, known: Known) -> Floats:
    ratio = np.asarray(f, dtype=np.float64) / known.low_pass_hz
    return np.asarray(1.0 / np.sqrt(1.0 + ratio ** (2 * known.low_pass_order)))


def _checked(samples: ArrayLike, spacing_s: float, frequency_hz: float) -> Floats:
    values = np.asarray(samples, dtype=np.float64)
    if values.size < 64 or 2.0 * frequency_hz * spacing_s > 0.95:
        raise ConfigError(f"{values.size} samples, one every {spacing_s:g} s, hold no sine of {frequency_hz:g} Hz")
    return values


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


def _straightened(tones: Sequence[Tone], known: Known, shape: Floats | None = None) -> Floats:
    """Return the amplitudes without the compression of the output stage, which the third harmonics tell.

    A cube of the output makes three times as much of the fundamental as of the third harmonic. The modulator makes a
    third harmonic too, the same at all frequencies, that passes through the modes: with the `shape` of the response it
    is told from the other; without, tones near the peak tell enough.
    """
    level, third, u = np.array([(tone.amplitude, tone.third, tone.u_amplitude) for tone in tones]).T
    if shape is None:
        high = level > 0.5 * level.max()
        cube = float(third[high] @ level[high] ** 3) / float((level[high] ** 6).sum())
    else:
        f = np.array([tone.frequency_hz for tone in tones])
        one, three = (_filtered(order * f, known, shape) for order in (1.0, 3.0))
        columns = np.column_stack([level**3, (three * (one.conj() / np.abs(one)) ** 3).real]) / u[:, None]
        cube = float(np.linalg.lstsq(columns, third / u, rcond=None)[0][0])
    return np.asarray(level * (1.0 - 3.0 * cube * level**2))


def fit_rate_band(tones: Sequence[Tone], amplitude: float, known: Known) -> RateBand:
    """Fit the closed form to tones that one amplitude at the input gave.

    The output stage's compression is read from the third harmonics and taken out. The noise of each tone is that of
    all tones with the same spacing of samples: part of it is flat, part passes through the modes as the response does.

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
    gain = _straightened(ordered, known) / filter_gain / amplitude
    place = int(gain.argmax())
    q = max(1.0, float(gain[place] / gain[0])) * known.drive_hz / f[place]
    u = np.array([tone.u_amplitude for tone in ordered]) / filter_gain / amplitude
    u = np.hypot(np.maximum(u, float(np.median(u / gain)) * gain), known.off_form * gain)

    unknown = 0.8, known.in_phase_split_hz, 0.0

    def least(start: Floats, u: Floats) -> ModelFit:
        """Return the better of two fits, because a start far off can end at a wrong minimum with a false lag."""
        fits = [fit_model(lambda p: _residuals(p, f, gain, u, known), start, "bandwidth")]
        again = np.array([*fits[0].parameters[:3], *unknown])
        fits.append(fit_model(lambda p: _residuals(p, f, gain, u, known), again, "bandwidth"))
        return min(fits, key=lambda fit: fit.chi_square)

    def without_lag(fit: ModelFit) -> Floats:
        """Return a start without a lag near 0, because its scale and slope would be rounding errors."""
        return np.array([*fit.parameters[:-1], 0.0])

    def fitted(side: float, u: Floats) -> tuple[ModelFit, Floats]:
        start = np.array([side * f[place], q, gain[0], *unknown])
        for _ in range(2):
            fit = least(start, u)
            start = without_lag(fit)
            u = np.hypot(_smooth_u(ordered, fit.parameters, known) / filter_gain / amplitude, known.off_form * gain)
        return least(start, u), u

    sides: list[tuple[ModelFit, Floats]] = []
    for side in (1.0, -1.0):
        with suppress(ConfigError):
            sides.append(fitted(side, u))
    if not sides:
        raise ConfigError("bandwidth: the points do not determine the model")
    best, *others = sorted(sides, key=lambda each: (each[0].parameters[3] < 0.0, each[0].chi_square))
    either = any(o.parameters[3] > 0.0 and o.chi_square < best[0].chi_square + _TELLS for o, _ in others)
    gain = _straightened(ordered, known, _shape(best[0].parameters)) / filter_gain / amplitude
    fit = fit_model(lambda p: _residuals(p, f, gain, best[1], known), without_lag(best[0]), "bandwidth")
    dof = sum(tone.noise_dof for tone in ordered)
    return _band(fit, known.drive_hz, f, gain, best[1], noise_dof=dof, either_side=either)


def _shape(parameters: Floats) -> Floats:
    return parameters[..., [0, 1, 3, 4, 5]]


def _residuals(parameters: Floats, f: Floats, gain: Floats, u: Floats, known: Known) -> Floats:
    model = parameters[..., 2:3] * split_response(f, known.drive_hz, _shape(parameters))
    place = (parameters[..., 4:5] - known.in_phase_split_hz) / known.u_in_phase_split_hz
    return np.concatenate([(model - gain) / u, place, parameters[..., 5:6] / known.u_phase_rad], axis=-1)


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
    dof = f.size + 2 - fit.parameters.size
    # Gains that lie further off the form than their noise says are as uncertain as that (Birge 1932)
    wider = max(1.0, fit.chi_square / dof)
    fit = replace(fit, covariance=wider * fit.covariance)
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
        parameters=fit.parameters,
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
    shape = _shape(parameters)
    split = float(shape[0])

    def gain(at_hz: float) -> float:
        return float(split_response(at_hz, drive_hz, shape)[0])

    size = abs(split)
    near = 1e-4 * size
    peak = _zero(lambda at: gain(at + near) - gain(at - near), 0.5 * size, 1.5 * size)
    plus_3_db = _zero(lambda at: gain(at) - math.sqrt(2.0), 0.0, peak)
    # The first one above the peak: the other mode may raise the gain again
    steps = peak + 0.05 * peak * np.arange(1, 100)
    below = split_response(steps, drive_hz, shape) < math.sqrt(0.5)
    minus_3_db = _zero(lambda at: gain(at) - math.sqrt(0.5), peak, float(steps[below.argmax()]))
    near_stiffness, far_stiffness = ((drive_hz - each) ** 2 - drive_hz**2 for each in (split, parameters[4]))
    far = parameters[3] / far_stiffness
    return np.array([plus_3_db, peak, gain(peak), minus_3_db, far / (far + 1.0 / near_stiffness)])


def _zero(value: Callable[[float], float], low: float, high: float) -> float:
    """Return where `value` passes 0, by false position; an end that stays counts half (the Illinois rule)."""
    below, above = value(low), value(high)
    if not below * above < 0.0:
        raise ConfigError("bandwidth: the fitted response has no peak, or never passes half of its static power")
    at, side = low, 0
    for _ in range(_TRIES):
        before, at = at, (low * above - high * below) / (above - below)
        if abs(at - before) < _CLOSE_HZ:
            break
        here = value(at)
        if here * above > 0.0:
            high, above, below, side = at, here, below * (0.5 if side > 0 else 1.0), 1
        else:
            low, below, above, side = at, here, above * (0.5 if side < 0 else 1.0), -1
    return at
