"""Names in words."""

from __future__ import annotations

import pytest

from vcfbench.values.kinds import in_words, named


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("settle_s", ("settle", "s")),
        ("rates_deg_s", ("rates", "deg/s")),
        ("k_vc_guess_deg_s_per_v", ("K_Vc guess", "(deg/s)/V")),
        ("drive.frequency_hz", ("drive, frequency", "Hz")),
        ("repeat", ("repeat", "")),
    ],
)
def test_a_key_is_words_and_a_unit(key: str, words: tuple[str, str]) -> None:
    assert in_words(key) == words


def test_results_are_named_with_the_unit_that_people_read() -> None:
    of = named("turntable.scale_factor", "V/(deg/s)")
    assert (of.words, of.factor, of.unit) == ("scale factor, on the table", 1e3, "mV/(deg/s)")
    assert of.german == "Skalenfaktor, Drehtisch"
    assert named("bias", "furlong") == ("bias", "", 1.0, "furlong")
    assert named("own.gain_v")[:4] == ("own: gain", "", 1.0, "V")
    assert named("nonlinearity_ppm.max_span")[:4] == ("nonlinearity: max span", "", 1.0, "ppm")


def test_e_n_of_fits_has_own_name() -> None:
    assert named("comparison.e_n").words == "comparison: E_n of the fits' scatter alone, no verdict"
    assert (named("e_n").words, named("drift.e_n").words) == ("E_n", "drift: E_n")
