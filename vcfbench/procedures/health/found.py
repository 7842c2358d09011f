"""Characteristics of a device by the oscilloscope's records: modes, phases, feed-through, amplitudes, uncertainties."""

import cmath
import math
from collections.abc import Sequence
from statistics import fmean, variance
from typing import TypeAlias

from msgspec import structs

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.rotating import reference_phase
from vcfbench.errors import MeasurementError
from vcfbench.instructions.v_vc import KnownVvcSettings
from vcfbench.procedures.health.plan import RING_DOWNS, CaptureFar, Modes, level_v, middle_of, modes_of
from vcfbench.procedures.resonance import rang_down
from vcfbench.records.device_values import Characteristics
from vcfbench.records.device_values import Measured as Kept
from vcfbench.steps import CaptureMeanSines, CaptureRotations, RotationRecord, Rotations, SineRecord, SineRecords
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty import oscilloscope
from vcfbench.uncertainty.measurand import as_kept, mean_of_records, measurand, quality_of
from vcfbench.uncertainty.oscilloscope import CaptureSense
from vcfbench.values.value import Measurand, UncertaintyPart

_FLAT = 0.05
"""By which a feed-through may differ between the frequencies where it shows and that of the drive (assumed)."""
_ROUNDS = 5
_GAIN, _EXCHANGED = "vertical gain, of both amplitudes", "ratio of carrier to drive, probes exchanged"
_SHARE = "shares of the modes, as the certificate has them"


Health: TypeAlias = dict[str, Measurand]
"""Measured characteristics that K_Vc depends on, by their names in :class:`.Characteristics`.

`sense_phase_deg` is by how much the phase of what V_Vc does to the sense signal is ahead of what carrier, splits and
quality factors make of it: 0 where nothing else is at work.
"""


def beside(found: Health, known: Characteristics) -> Characteristics:
    """Return the characteristics for the device store, in addition to the `known` ones."""
    seen = {name: as_kept(each) for name, each in found.items()}
    only_size = {"split_size_hz": None} if "split_hz" in seen else {}
    return structs.replace(known, **only_size, **seen)


def unchanged(found: Health, then: Characteristics) -> Health:
    """Return the same findings of an unchanged device: the values of `then`, with their uncertainties."""

    def same(kept: Kept) -> Measurand:
        parts = [UncertaintyPart(each.source, each.u, each.dof, each.of) for each in kept.shares]
        return measurand(kept.value, "", parts or [UncertaintyPart("certificate", kept.u, kept.dof)])

    kept = {name: getattr(then, name) for name in found}
    return found | {name: same(each) for name, each in kept.items() if each is not None}


def health_of(settings: KnownVvcSettings, measured: Measured, then: Characteristics | None = None) -> Health:
    """Return the characteristics that K_Vc depends on, from the steps of :mod:`.plan`; empty without them.

    `then` are those of the certificate.

    Raises:
        MeasurementError: only one mode rang down, or V_Vc does not move the sense signal.
    """
    decays = rang_down(measured, RING_DOWNS, modes=2)
    if not measured.found(Rotations):
        return {}
    scope = settings.station.instruments["oscilloscope"].owner
    pairs = [modes_of(each) for each in decays]
    middle = middle_of(pairs)
    at_rest_v, phase_deg, of_phase = _at_rest(measured, level_v(settings))
    means, turned = means_of(measured, settings.station.channel_of("drive"))
    skew = oscilloscope.skew(middle.drive_hz, scope)
    carrier = mean_of_records([math.remainder(each.phases_deg[1] - 90.0, 180.0) for each in means], "deg", skew)
    share, beyond_deg = _share(pairs, at_rest_v, phase_deg, carrier.value)
    drive_v = fmean(each.amplitudes_v[0] for each in means)
    carrier_v = [drive_v * ratio for ratio in carrier_over_drive(means, turned)]
    turns = [(step, found) for step, found in measured.found(Rotations) if isinstance(step, CaptureRotations)]
    far = [each for step, found in turns if isinstance(step, CaptureFar) for each in found.records]
    near = [(step, found) for step, found in turns if not isinstance(step, CaptureFar)]
    near_hz = abs(near[0][0].difference_hz)
    reference = reference_phase(oscilloscope.aimed([each for _, found in near for each in found.records], near_hz))
    reference_deg = math.remainder(reference.phase_deg - 90.0, 180.0)
    records = UncertaintyPart("records", reference.u_phase_deg, reference.dof)
    kept_share = _share_of(then, middle) or as_kept(share)

    # A channel with its probe: of the same number on another day it may have another gain
    gain, middle_v = settings.station.sources.oscilloscope_gain_error / math.sqrt(3.0), fmean(carrier_v)
    left = 1e-6 * settings.station.sources.exchanged_ratio_ppm / math.sqrt(3.0)
    ratio = (_EXCHANGED, left) if turned else ("vertical gain, ratio of carrier to drive", math.sqrt(2.0) * gain)
    of_carrier = [UncertaintyPart(ratio[0], ratio[1] * middle_v), UncertaintyPart(_GAIN, gain * middle_v, of=_GAIN)]

    return {
        "drive_hz": oscilloscope.frequency_of([each.drive_hz for each in pairs], scope),
        "split_hz": oscilloscope.frequency_of([each.drive_hz - each.anti_phase.frequency_hz for each in pairs], scope),
        "q_anti_phase": quality_of([each.anti_phase.q for each in pairs]),
        "in_phase_split_hz": oscilloscope.frequency_of(
            [each.drive_hz - each.in_phase.frequency_hz for each in pairs], scope
        ),
        "q_in_phase": quality_of([each.in_phase.q for each in pairs]),
        "in_phase_share": share,
        "carrier_phase_deg": carrier,
        "demodulator_phase_deg": measurand(reference_deg, "deg", [records, skew]),
        "v_vc_feedthrough": _feedthrough(far, middle, kept_share, at_rest_v),
        "drive_amplitude_v": measurand(drive_v, "V", [UncertaintyPart(_GAIN, gain * drive_v, of=_GAIN)]),
        "carrier_amplitude_v": mean_of_records(carrier_v, "V", *of_carrier),
        "sense_phase_deg": measurand(beyond_deg, "deg", [of_phase, skew]),
    }


def means_of(measured: Measured, on_drive: int) -> tuple[list[SineRecord], list[SineRecord]]:
    """Return the means with the drive on channel `on_drive`, and those with its probe and the carrier's exchanged."""
    found: tuple[list[SineRecord], list[SineRecord]] = [], []
    for step, records in measured.found(SineRecords):
        if isinstance(step, CaptureMeanSines):
            found[step.channels[0] != on_drive].extend(records.records)
    return found


def carrier_over_drive(means: Sequence[SineRecord], turned: Sequence[SineRecord]) -> list[float]:
    """Return the carrier's amplitude over the drive's; with those of exchanged probes no gain is in it."""
    ratios = [each.amplitudes_v[1] / each.amplitudes_v[0] for each in means]
    others = [each.amplitudes_v[1] / each.amplitudes_v[0] for each in turned] or ratios
    return [math.sqrt(one * other) for one, other in zip(ratios, others, strict=True)]


def _at_rest(measured: Measured, level: float) -> tuple[float, float, UncertaintyPart]:
    """Return amplitude (V) and phase against the drive's velocity (deg, with its u) of the response to V_Vc.

    They are those of half the difference of the sense signal's phasors at both signs.
    """
    states = [(step, found) for step, found in measured.found(SineRecords) if isinstance(step, CaptureSense)]
    signs = oscilloscope.at_both_signs(states, lambda step: 0.0 if step.rate_deg_s else step.v_vc_v)
    plus, minus = ([each / level for each in sign] for sign in signs)
    moved = 0.5 * (sum(plus) / len(plus) - sum(minus) / len(minus))
    if abs(moved) < 1e-3 * max(map(abs, plus)):
        raise MeasurementError("V_Vc of either sign does not move the sense signal", instrument="oscilloscope")
    across = [0.25 * variance((each / moved).imag for each in state) / len(state) for state in (plus, minus)]
    phase_deg = math.degrees(cmath.phase(moved)) - 90.0
    u_deg = math.degrees(math.sqrt(sum(across)))
    return level * abs(moved), phase_deg, UncertaintyPart("records", u_deg, len(plus) + len(minus) - 2)


def _share(
    pairs: Sequence[Modes], at_rest_v: float, phase_at_rest_deg: float, carrier_deg: float
) -> tuple[Measurand, float]:
    """Return the share of the in-phase mode, and the unexplained phase of the sense signal, deg.

    Amplitudes of a ring-down are those when its record begins; when V_Vc went off the amplitude at rest tells. Whether
    the in-phase mode is seen with the sign of the other, the phase tells.
    """
    expected = []
    for sign in (1.0, -1.0):
        shares = [_one_share(each, sign, at_rest_v) for each in pairs]
        share = fmean(shares)
        phase_deg = carrier_deg + math.degrees(cmath.phase(middle_of(pairs).answer(share, 0.0)))
        left_deg = math.remainder(phase_at_rest_deg - phase_deg, 180.0)
        expected.append((abs(left_deg), left_deg, shares))
    _, left_deg, shares = min(expected)
    return mean_of_records(shares, ""), left_deg


def _share_of(then: Characteristics | None, now: Modes) -> Kept | None:
    """Return the part of the in-phase mode as the certificate had it, with the splits of now; None where unknown.

    Force and pick-off of either mode stay as they were, so that an error of their shares is one of then and of now.
    """
    if then is None or not (then.in_phase_share and then.split_hz and then.in_phase_split_hz):
        return None
    stiffer = [
        (now.drive_hz - mode.frequency_hz) / split.value
        for mode, split in ((now.anti_phase, then.split_hz), (now.in_phase, then.in_phase_split_hz))
    ]
    kept = then.in_phase_share
    forces = (1.0 - kept.value) / stiffer[0], kept.value / stiffer[1]
    return Kept(value=forces[1] / sum(forces), u=kept.u, dof=kept.dof)


def _one_share(pair: Modes, sign: float, at_rest_v: float) -> float:
    """Return the share by one ring-down.

    V_Vc goes off anywhere in a period of the drive: a displacement rings on as it is, a velocity by w_d / w_0 larger.
    """
    answers, modes = pair.answers(0.0), (pair.anti_phase, pair.in_phase)
    forced_v = [2.0 * mode.amplitude_v / (1.0 + pair.drive_hz / mode.frequency_hz) for mode in modes]
    late_s = 0.0
    forces = [1.0, 0.0]
    for _ in range(_ROUNDS):
        forces = [
            each * level_v * math.exp(math.pi * mode.frequency_hz / mode.q * late_s) / abs(answer)
            for each, level_v, mode, answer in zip((1.0, sign), forced_v, modes, answers, strict=True)
        ]
        moved_v = abs(forces[0] * answers[0] + forces[1] * answers[1])
        late_s += pair.anti_phase.q / (math.pi * pair.anti_phase.frequency_hz) * math.log(at_rest_v / moved_v)
    static = [force / (1.0 / answer).real for force, answer in zip(forces, answers, strict=True)]
    return static[1] / (static[0] + static[1])


def _feedthrough(far: Sequence[RotationRecord], modes: Modes, share: Kept, at_rest_v: float) -> Measurand:
    """Return the feed-through without motion over the modes' response at rest.

    Far above and far below the drive the modes answer with opposite signs, the feed-through with one: of the two
    amplitudes one is larger by it, the other smaller.
    """
    above, below = ([each for each in far if sign * each.difference_hz > 0.0] for sign in (1.0, -1.0))
    pairs = list(zip(above, below, strict=True))
    value = mean_of_records([_through(pair, modes, share.value, at_rest_v) for pair in pairs], "")
    moved = fmean(_through(pair, modes, share.value + share.u, at_rest_v) for pair in pairs) - value.value
    flat = UncertaintyPart("the same at all frequencies", _FLAT / math.sqrt(3.0) * abs(value.value))
    return measurand(
        value.value, "", [*value.parts, UncertaintyPart("in-phase share", abs(moved), share.dof, _SHARE), flat]
    )


def _through(records: tuple[RotationRecord, RotationRecord], modes: Modes, share: float, at_rest_v: float) -> float:
    """Return it from one record above and one below; the sine's line is half its peak, which is twice the level."""
    static = abs(modes.answer(share, 0.0))
    answers = [modes.answer(share, each.difference_hz).real / static for each in records]
    seen = [each.turning_v / at_rest_v for each in records]
    gain = (seen[0] + seen[1]) / (answers[1] - answers[0])
    return seen[1] / gain - answers[1]


def with_output_curve(known: Characteristics, slopes: Floats, covariance: Floats) -> Characteristics:
    """Return `known` with the output's second and third order against the rate, as a cubic had them.

    `slopes` are its coefficients from the first order on, `covariance` is theirs.
    """
    first = slopes[0]
    second, third = (
        Kept(value=float(slopes[order] / first), u=math.sqrt(covariance[order, order]) / abs(float(first)))
        for order in (1, 2)
    )
    return structs.replace(known, output_second_per_deg_s=second, output_third_per_deg_s2=third)
