"""Split and Q by the multimeter: the response to a few sines on V_Vc."""

import math

from vcfbench import steps
from vcfbench.analysis.rate_band import Known, NearSplit, fit_near_split, split_response
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.bandwidth import tones_of
from vcfbench.procedures.shared.known.k_vc_change import ASSUMED
from vcfbench.procedures.shared.known.v_vc import KnownVvcSettings
from vcfbench.procedures.shared.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.procedures.shared.routines import rails_of, set_sine, v_vc_level_again, v_vc_on
from vcfbench.procedures.shared.tones import HIGHEST_HZ, NPLC, sampled_every_s, stands_off_mains
from vcfbench.records.devices import Characteristics
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Routine

_OF_SPLIT, _SINE_V, _SAMPLES = (0.1, 0.6, 0.94, 1.0, 1.06, 1.4), 0.1, 512
"""Frequencies of the sines over the split that was, their peak, and readings of each."""
_OF_THE_OTHER = ("drive_hz", "in_phase_split_hz", "in_phase_share")
_ALIKE = 0.2
"""Largest share of a change of Q by which that of the in-phase mode may differ (assumed): gas damps both alike."""


def split_by_meter(settings: KnownVvcSettings, then: Characteristics) -> Routine[None]:
    """Have V_Vc a sine of a few frequencies about the split that was, and sample the output; V_Vc is off afterwards."""
    assert then.split_hz is not None  # noqa: S101  # the caller saw
    assert then.q_anti_phase is not None  # noqa: S101
    drive, far, share = (getattr(then, name) or ASSUMED[name] for name in _OF_THE_OTHER)
    split_hz, known = then.split_hz.value, Known(drive.value, far.value)
    force = _force(share.value, drive.value, split_hz, far.value)
    yield steps.Note("Health: split and Q, by a few sines on V_Vc through the multimeter")
    yield steps.ConfigureMeter(float(settings.meter_range_v), NPLC)
    yield from v_vc_on()
    for ratio in _OF_SPLIT:
        frequency_hz = float(f"{ratio * split_hz:.4g}")
        if frequency_hz > HIGHEST_HZ or not stands_off_mains(frequency_hz, settings.station.mains_hz, _SAMPLES):
            continue
        yield from set_sine(settings, frequency_hz, _SINE_V)
        # The response over that at rest, with its filter, of the device as its certificate has it
        passed = split_response(frequency_hz, drive.value, (split_hz, then.q_anti_phase.value, force, far.value, 0.0))
        low_pass = (frequency_hz / known.low_pass_hz) ** (2 * known.low_pass_order)
        interval_s, gain = sampled_every_s(frequency_hz), float(passed[0] / math.sqrt(1.0 + low_pass))
        yield steps.SampleSine(frequency_hz, _SINE_V, _SAMPLES, interval_s, split_hz, gain)
    yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
    yield from v_vc_level_again()
    yield steps.DisableVvc()
    yield steps.CheckRails(rails_of(settings), settings.rail_tolerance_v)


def _force(share: float, drive_hz: float, split_hz: float, far_hz: float) -> float:
    """Return force and pick-off of the in-phase mode over the other, by its share of the response at rest."""
    stiff = [(drive_hz - each) ** 2 - drive_hz**2 for each in (far_hz, split_hz)]
    return share / (1.0 - share) * stiff[0] / stiff[1]


def found_by_sines(
    settings: KnownVvcSettings, measured: Measured, then: Characteristics | None
) -> dict[str, Measurand]:
    """Return split and both Q as the sines tell them, by name; nothing where there were none.

    Q of the in-phase mode is scaled with the other's: what damps one damps the other.

    Raises:
        MeasurementError: the response is not that of the two modes, or has too few tones.
    """
    sines = [
        (step.frequency_hz, each)
        for step, each in measured.found(steps.SineResponse)
        if isinstance(step, steps.SampleSine)
    ]
    if not sines or then is None or then.split_hz is None or then.q_anti_phase is None:
        return {}

    tones = tones_of(settings, sines)
    drive, far, share = (getattr(then, name) or ASSUMED[name] for name in _OF_THE_OTHER)
    split, q = then.split_hz.value, then.q_anti_phase.value

    def fitted(
        *, far_hz: float = far.value, part: float = share.value, lag_deg: float = 0.0, pass_hz: float = 100.0
    ) -> NearSplit:
        force = _force(part, drive.value, split, far_hz)
        known = Known(drive.value, far_hz, low_pass_hz=pass_hz)
        try:
            return fit_near_split(tones, known, (split, q), (force, math.radians(lag_deg)))
        except ConfigError as error:
            raise MeasurementError(f"split and Q: {error.what}", instrument="multimeter") from error

    found, one = fitted(), 1.0 / math.sqrt(3.0)
    others = {
        "in-phase mode": (fitted(far_hz=far.value + 5.0), one),
        "in-phase share": (fitted(part=share.value + share.u), 1.0),
        "phase of the demodulator": (fitted(lag_deg=2.0), one),
        "filter's corner": (fitted(pass_hz=90.0), one),
    }
    split_parts = [
        UncertaintyPart(name, by * abs(each.split_hz - found.split_hz)) for name, (each, by) in others.items()
    ]
    q_parts = [UncertaintyPart(name, by * abs(each.q - found.q)) for name, (each, by) in others.items()]
    q_parts.append(UncertaintyPart("tones", found.u_q))
    seen = {
        "split_hz": measurand(found.split_hz, "Hz", [UncertaintyPart("tones", found.u_split_hz), *split_parts]),
        "q_anti_phase": measurand(found.q, "", q_parts),
    }
    if then.q_in_phase is not None:
        ratio, in_phase = found.q / q, then.q_in_phase
        alike = UncertaintyPart("damped alike", one * _ALIKE * abs(1.0 - ratio) * in_phase.value)
        parts = [UncertaintyPart(each.source, each.u * in_phase.value / q) for each in q_parts]
        seen["q_in_phase"] = measurand(in_phase.value * ratio, "", [alike, *parts])
    return seen
