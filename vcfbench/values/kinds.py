"""Names of results and settings in words, with the unit in which people read them; programs keep their own names."""

import re
from typing import Final, NamedTuple


class Named(NamedTuple):
    """Words for a value, in English and where known in German; `factor` times the value is in `unit`."""

    words: str
    german: str = ""
    factor: float = 1.0
    unit: str = ""


_KNOWN: Final = {
    ("scale_factor", "V/(deg/s)"): Named("scale factor", "Skalenfaktor", 1e3, "mV/(deg/s)"),
    ("comparison.e_n", ""): Named("E_n of the fits' scatter alone, no verdict"),
    ("bias", "V"): Named("bias (output)", "Nullpunkt (Ausgang)", 1e3, "mV"),
    ("bias_deg_s", "deg/s"): Named("bias", "Nullpunkt", 1.0, "deg/s"),
    ("bias_difference_v", "V"): Named("difference of the biases", "Differenz der Nullpunkte", 1e3, "mV"),
    ("nonlinearity", "ppm"): Named("non-linearity, of the span", "Nichtlinearität, der Spanne", 1.0, "ppm"),
    ("k_vc", "(deg/s)/V"): Named("K_Vc, rate per volt of V_Vc", "K_Vc, Drehrate je Volt V_Vc", 1.0, "(deg/s)/V"),
    ("scale_factor_error_percent", "%"): Named(
        "virtual scale factor against the table's", "virtueller Skalenfaktor gegen Drehtisch", 1.0, "%"
    ),
}
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


def named(name: str, unit: str = "") -> Named:
    """Return words for a result by its name in programs, such as ``turntable.scale_factor``, and its unit there."""
    column, _, last = name.rpartition(".")
    found = _KNOWN.get((name, unit), _KNOWN.get((last, unit)))
    if found is None:
        words, of_name = in_words(last)
        found = Named(words, unit=unit or of_name)
    where = _COLUMNS.get(column)
    if where is None:
        within, of_column = in_words(column)
        words = f"{within}: {found.words}" if column else found.words
        return found._replace(words=words, german="" if column else found.german, unit=found.unit or of_column)
    german = f"{found.german}, {where[1]}" if found.german else ""
    return found._replace(words=f"{found.words}, {where[0]}", german=german)


def in_words(key: str) -> tuple[str, str]:
    """Return a key as words and the unit at its end: ``settle_s`` is ``settle`` in ``s``."""
    end = next((each for each in _UNITS if key.endswith(each) and len(key) > len(each)), "")
    words = key.removesuffix(end).replace("_", " ").replace(".", ", ")
    for short, sign in _SIGNS.items():
        words = re.sub(rf"\b{short}\b", sign, words)
    return words, _UNITS.get(end, "")
