"""Typography of names and units on pages: V with the index Vc, degrees as a sign, a thin space before a unit.

Reports are written in plain characters, as terminals and files of numbers have them: ``V_Vc``, ``deg/s^2``. Only what
is made for reading asks here, so that a name looks the same in HTML, PDF, Markdown and certificates.
"""

import re
from collections.abc import Callable
from typing import Final

_NAMES: Final = {"V_Vc": ("V", "Vc"), "K_Vc": ("K", "Vc"), "Ω_z": ("Ω", "z"), "E_n": ("E", "n"), "U95": ("U", "95")}
_NAME: Final = re.compile(rf"(?<![\w.\-])({'|'.join(_NAMES)})(?![\w])")
_THIN: Final = "\u202f"  # A narrow space at which no line is broken
_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_UNIT: Final = r"(?:[munkMµ]?(?:V|A|W|Hz)|[mµn]?s|h|min|K|ppm|%|°C|°/|\(°/)"
_RULES: Final[tuple[tuple[re.Pattern[str], str | Callable[[re.Match[str]], str]], ...]] = (
    (re.compile(r"(?<![\w.])Omega_z(?!\w)"), "Ω_z"),
    (re.compile(r"\bu(?=[VAs]\b)"), "µ"),
    (re.compile(r"\bdegC\b"), "°C"),
    (re.compile(r"(?<=[\d)]) deg\b(?!/)"), "°"),
    (re.compile(r"(?<=/ )deg$|^deg$|(?<![\w.])deg(?=/)"), "°"),
    (re.compile(r"(?<=/)sqrt\((\w+)\)"), r"√\1"),
    (re.compile(r"(?<=[A-Za-z°])\^(-?\d)(?!\d)"), lambda found: found[1].translate(_RAISED)),
    (re.compile(rf"(?<=[\d)]) (?={_UNIT}(?!\w))|(?<=[\d)]) (?=V/|\(°|°/)"), _THIN),
)


def in_unicode(text: str) -> str:
    """Return `text` with signs in place of words for units and Greek letters, and thin spaces before units."""
    for rule, sign in _RULES:
        text = rule.sub(sign, text)
    return text


def marked_up(text: str, escaped: Callable[[str], str]) -> str:
    """Return `text` set as :func:`in_unicode` does, names with their index as HTML has it, all else `escaped`."""
    set_text = ""
    for place, piece in enumerate(_NAME.split(in_unicode(text))):
        if place % 2:
            letter, index = _NAMES[piece]
            set_text += f"<i>{letter}</i><sub>{index}</sub>"
        else:
            set_text += _THIN.join(map(escaped, piece.split(_THIN)))  # which Python does not call printable
    return set_text


def marked_up_in_svg(text: str) -> str:
    """Return the words of an SVG text, escaped already, with the index of names below their line."""
    first, *rest = _NAME.split(text)
    found = first
    for name, words in zip(rest[::2], rest[1::2], strict=True):
        letter, index = _NAMES[name]
        found += f'{letter}<tspan dy="2" font-size="75%">{index}</tspan>' + (
            f'<tspan dy="-2">{words}</tspan>' if words else ""
        )
    return found
