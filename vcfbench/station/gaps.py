"""Contributions to uncertainties that are not stated, and the values that are incomplete without each."""

from msgspec import Struct


class Gap(Struct, frozen=True):
    """Contribution without a statement or a figure for its class: values of `kinds` are incomplete."""

    name: str
    words: str
    kinds: tuple[str, ...]

    def leaves_out(self, kind: str) -> bool:
        """Return True if values of `kind` lack it: those of `kinds`, and those that nobody has thought of here."""
        return kind in self.kinds or kind not in _THOUGHT_OF


_BIASES, _SLOPES = ("bias", "bias_deg_s", "bias_v"), ("scale_factor", "line")
GAPS = {
    "meter_gain": Gap("multimeter", "the multimeter's accuracy", (*_SLOPES, *_BIASES)),
    "table_rate": Gap("table rate", "the table's accuracy (uncertainty.table_rate_error)", (*_SLOPES, "k_vc")),
    "warm_up_k": Gap("warm-up", "warm-up (uncertainty.warm_up_k)", (*_SLOPES, *_BIASES, "asymmetry")),
    "temperature_k": Gap(
        "temperature",
        "temperature: the values hold at the temperature of the run (uncertainty.temperature_k)",
        (*_SLOPES, *_BIASES, "k_vc"),
    ),
    "misalignment_deg": Gap(
        "misalignment",
        "the angle between the gyroscope's axis and the table's (uncertainty.misalignment_deg)",
        (*_SLOPES, *_BIASES, "k_vc"),
    ),
    "carrier_phase_deg": Gap(
        "carrier phase",
        "a change of the carrier's phase: K_Vc holds at the phase of the run (uncertainty.carrier_phase_deg)",
        ("k_vc",),
    ),
    "demodulator_phase_deg": Gap(
        "demodulator phase",
        "a change of the demodulator's phase: it changes scale factor and, with quadrature, bias "
        "(uncertainty.demodulator_phase_deg)",
        (*_SLOPES, *_BIASES, "k_vc"),
    ),
    "bias_deg_s_demodulator_deg": Gap(
        "quadrature",
        "quadrature in the bias by the demodulator's phase (uncertainty.bias_deg_s_demodulator_deg; `phase` "
        "measures it)",
        _BIASES,
    ),
}
_DIFFERENCES = {"bias_difference_v", "scale_factor_error_percent"}
"""Of two methods in one run, in which it cancels."""
_THOUGHT_OF = {kind for gap in GAPS.values() for kind in gap.kinds} | _DIFFERENCES
