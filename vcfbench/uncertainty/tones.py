"""Sampling of sines: common parts of `bandwidth`, `vibration` and others."""

from collections.abc import Sequence

from vcfbench.analysis.tone import Tone, fit_tone, true_spacing_s
from vcfbench.steps import ModulatedRecord, SineResponse

NPLC = 0.2
"""Integration time of a reading, power-line cycles: ten, as elsewhere, would average the mode split away."""
HIGHEST_HZ = 79.0
SLOW_BELOW_HZ = 4.0
_FAST_S, _SLOW_S = 5e-3, 47e-3
_APART = 2.5
"""Periods over a record by which a tone must differ from the mains."""


def sampled_every_s(frequency_hz: float) -> float:
    """Return the spacing of the samples of a tone, s.

    No tone up to 79 Hz is folded; below 4 Hz records are longer, and their spacing folds the mains away from it.
    """
    return _SLOW_S if frequency_hz < SLOW_BELOW_HZ else _FAST_S


def stands_off_mains(frequency_hz: float, mains_hz: float, record_samples: int) -> bool:
    """Return True if a record of so many samples takes a tone and the mains, which the leads pick up, apart."""
    return abs(frequency_hz - mains_hz) > _APART / (record_samples * _FAST_S)


def fitted_tones(
    records: Sequence[tuple[float, SineResponse | ModulatedRecord, Sequence[float]]], mains_hz: float
) -> list[Tone]:
    """Fit the sine of a frequency, Hz, in the volts of each record.

    Records of one interval share their spacing.
    """
    spacing_s = {
        interval_s: true_spacing_s(
            [(hz, volts) for hz, record, volts in records if record.interval_s == interval_s], interval_s
        )
        for interval_s in {record.interval_s for _, record, _ in records}
    }
    return [
        fit_tone(volts, spacing_s[record.interval_s], record.aperture_s, hz, mains_hz=mains_hz)
        for hz, record, volts in records
    ]
