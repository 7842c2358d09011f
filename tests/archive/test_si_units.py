"""Units in the words of D-SI."""

from __future__ import annotations

import pytest

from vcfbench.archive.si_units import in_si


@pytest.mark.parametrize(
    ("unit", "scale", "words"),
    [
        ("V", 1.0, r"\volt"),
        ("", 1.0, r"\one"),
        ("ppm", 1e-6, r"\one"),
        ("%", 1.0, r"\percent"),
        ("V/V", 1.0, r"\one"),
        ("deg/s", 1.0, r"\degree\second\tothe{-1}"),
        ("V/(deg/s)", 1.0, r"\volt\degree\tothe{-1}\second"),
        ("(deg/s)/V", 1.0, r"\degree\second\tothe{-1}\volt\tothe{-1}"),
        ("deg/sqrt(h)", 1.0, r"\degree\hour\tothe{-0.5}"),
        ("(deg/h)/sqrt(h)", 1.0, r"\degree\hour\tothe{-1.5}"),
        ("deg/s^2", 1.0, r"\degree\second\tothe{-2}"),
        ("ppm/K", 1e-6, r"\kelvin\tothe{-1}"),
        ("V s^-1", 1.0, r"\volt\second\tothe{-1}"),
    ],
)
def test_a_unit_has_its_words(unit: str, scale: float, words: str) -> None:
    assert in_si(unit) == (scale, words)


@pytest.mark.parametrize("unit", ["furlong", "V/furlong", "V^x", "(V", "deg)/s"])
def test_what_is_no_known_unit_has_none(unit: str) -> None:
    assert in_si(unit) is None
