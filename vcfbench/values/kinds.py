"""Names of results and settings in words, with the unit in which people read them; programs keep their own names."""

import re
from functools import lru_cache
from typing import Final, NamedTuple


class Named(NamedTuple):
    """Words for a value, in English and where known in German; `factor` times the value is in `unit`."""

    words: str
    german: str = ""
    factor: float = 1.0
    unit: str = ""


class Kind(NamedTuple):
    """Kind of a value: names in English and German, SI unit, printed unit, and name in limits.

    `factor` times a value is in `unit`. A number that `stands_alone` needs no U95: a count, or a ratio to a U95.
    """

    words: str
    german: str = ""
    si: str = ""
    factor: float = 1.0
    unit: str = ""
    limit: str = ""
    """Key of ``[acceptance]``."""
    stands_alone: bool = False
    digits: str = ""
    """Format of a ratio that has no uncertainty."""


_SLOPE: Final = ("V/(deg/s)", 1e3, "mV/(deg/s)", "scale_factor_v_per_deg_s")
KINDS: Final = {
    "scale_factor": Kind("scale factor", "Skalenfaktor", *_SLOPE),
    "scale_factor_of_range": Kind("scale factor of the declared range", "Skalenfaktor des Messbereichs", *_SLOPE),
    "scale_factor_small": Kind("scale factor of small signals", "Skalenfaktor kleiner Signale", *_SLOPE),
    "scale_factor_by_v_vc": Kind("scale factor, by V_Vc", "Skalenfaktor, durch V_Vc", *_SLOPE),
    "bias": Kind("bias (output)", "Nullpunkt (Ausgang)", "V", 1e3, "mV", "bias_v"),
    "bias_deg_s": Kind("bias", "Nullpunkt", "deg/s", 1.0, "deg/s", "bias_deg_s"),
    "bias_at_rest": Kind("output at rest", "Ausgang in Ruhe", "V", 1e3, "mV", "bias_v"),
    "bias_at_rest_deg_s": Kind("bias at rest", "Nullpunkt in Ruhe", "deg/s", 1.0, "deg/s", "bias_deg_s"),
    "bias_by_v_vc": Kind("bias (output), by V_Vc", "Nullpunkt (Ausgang), durch V_Vc", "V", 1e3, "mV", "bias_v"),
    "bias_by_v_vc_deg_s": Kind("bias, by V_Vc", "Nullpunkt, durch V_Vc", "deg/s", 1.0, "deg/s", "bias_deg_s"),
    "bias_difference_v": Kind("difference of the biases", "Differenz der Nullpunkte", "V", 1e3, "mV"),
    "nonlinearity": Kind(
        "non-linearity, of the span", "Nichtlinearität, der Spanne", "ppm", 1.0, "ppm", "nonlinearity_ppm"
    ),
    "nonlinearity_by_v_vc": Kind(
        *("non-linearity, of the span, by V_Vc", "Nichtlinearität, der Spanne, durch V_Vc", "ppm", 1.0, "ppm"),
        "nonlinearity_ppm",
    ),
    "k_vc": Kind(
        *("K_Vc, rate per volt of V_Vc", "K_Vc, Drehrate je Volt V_Vc", "(deg/s)/V", 1.0, "(deg/s)/V"),
        "k_vc_deg_s_per_v",
    ),
    "scale_factor_error_percent": Kind(
        *("virtual scale factor against the table's", "virtueller Skalenfaktor gegen Drehtisch", "%", 1.0, "%"),
        "scale_factor_error_percent",
    ),
    "reading_noise_v": Kind("reading noise", "", "V", 1.0, "V", "reading_noise_v"),
    "drift_ppm": Kind("drift", "", "ppm", 1.0, "ppm", "drift_ppm"),
    "bias_repeatability": Kind("repeatability of the bias", "", "deg/s", 1.0, "deg/s", "bias_repeatability_deg_s"),
    "scale_factor_repeatability": Kind(
        "repeatability of the scale factor", "", "ppm", 1.0, "ppm", "scale_factor_repeatability_ppm"
    ),
    "e_n": Kind("E_n", limit="e_n", stands_alone=True, digits=".2f"),
    "e_n_since_last": Kind("E_n since last", limit="e_n_since_last", stands_alone=True, digits=".2f"),
    "cusum": Kind("cusum", limit="cusum", stands_alone=True, digits=".2f"),
    "failed_before": Kind("failed before", limit="failed_before", stands_alone=True),
    "wrong_signs": Kind("wrong signs", limit="wrong_signs", stands_alone=True),
    "comparison.e_n": Kind("E_n of the fits' scatter alone, no verdict", stands_alone=True, digits=".2f"),
}
"""Kinds by their names, which are those of results in programs."""
LIMITED: Final = {kind.limit: name for name, kind in reversed(KINDS.items()) if kind.limit}
"""Kinds by the keys of ``[acceptance]``; of several the first."""


_COLUMNS: Final = {"turntable": ("on the table", "Drehtisch"), "virtual": ("by V_Vc", "durch V_Vc")}
_UNITS: Final = {
    "_deg_s_per_v": "(deg/s)/V",
    "_v_per_deg_s": "V/(deg/s)",
    "_deg_s2": "deg/s^2",
    "_deg_s": "deg/s",
    "_deg_h": "deg/h",
    "_percent": "%",
    "_k_min": "K/min",
    "_ppm": "ppm",
    "_deg": "deg",
    "_hz": "Hz",
    "_ms": "ms",
    "_c": "degC",
    "_v": "V",
    "_a": "A",
    "_s": "s",
    "_h": "h",
    "_k": "K",
}
_SIGNS: Final = {
    "k vc": "K_Vc",
    "v vc": "V_Vc",
    "q": "Q",
    "e n": "E_n",
    "plus 3 db": "+3 dB",
    "minus 3 db": "-3 dB",
    "nplc": "integration time, mains cycles",
}


@lru_cache(4096)  # lists ask for the same few, record by record
def named(name: str, unit: str = "", kind: str = "") -> Named:
    """Return words for a result by its name in programs, such as ``turntable.scale_factor``, and its unit there.

    Without its `kind` that is the one which has its name and unit.
    """
    column, _, last = name.rpartition(".")
    if kind := kind or kind_of(name, unit):
        found = Named(*KINDS[kind][:2], *KINDS[kind][3:5])
        if unit and unit != KINDS[kind].si:
            found = found._replace(factor=1.0, unit=unit)
    else:
        words, of_name = in_words(last)
        found = Named(words, unit=unit or of_name)
    where = _COLUMNS.get(column)
    if where is not None and found.words.endswith(where[0]):
        return found
    if where is None:
        within, of_column = in_words(column)
        words = f"{within}: {found.words}" if column else found.words
        return found._replace(words=words, german="" if column else found.german, unit=found.unit or of_column)
    german = f"{found.german}, {where[1]}" if found.german else ""
    return found._replace(words=f"{found.words}, {where[0]}", german=german)


def slope_unit(unit: str) -> str:
    """Return the unit of a scale factor by that of the output: ``LSB/(deg/s)``."""
    return f"({unit})/(deg/s)" if "/" in unit else f"{unit}/(deg/s)"


STREAMED: Final = ("deg/s", "LSB", "LSB/s")
"""Units of an output that is no voltage."""
_IN_PLACE: Final = {"V": STREAMED, "V/(deg/s)": tuple(map(slope_unit, STREAMED))}
"""Units that stand where that of volts would, by the latter."""


def fits(kind: str, unit: str) -> bool:
    """Return True if a value of `kind` may be in `unit`: its own, or that of a stream in place of volts."""
    return kind in KINDS and (KINDS[kind].si == unit or unit in _IN_PLACE.get(KINDS[kind].si, ()))


def limit_words(key: str) -> Named:
    """Return the name of the quantity that a key of ``[acceptance]`` limits."""
    kind = LIMITED.get(key, "")
    return named(kind, KINDS[kind].si) if kind else named(key)


def kind_of(name: str, unit: str) -> str:
    """Return the kind with this `name` and `unit`, or None."""
    names = name, name.rpartition(".")[2]
    return next((each for each in names if each in KINDS and KINDS[each].si == unit), "")


def in_words(key: str) -> tuple[str, str]:
    """Return a key as words and the unit at its end: ``settle_s`` is ``settle`` in ``s``."""
    end = next((each for each in _UNITS if key.endswith(each) and len(key) > len(each)), "")
    words = key.removesuffix(end).replace("_", " ").replace(".", ", ")
    for short, sign in _SIGNS.items():
        words = re.sub(rf"\b{short}\b", sign, words)
    return words, _UNITS.get(end, "")
