"""Names and units as they are set on a page."""

from __future__ import annotations

import pytest

from vcfbench.reports.document import Column, Report, Table, Text
from vcfbench.reports.html_page import escaped, html_of
from vcfbench.reports.markdown import markdown_of
from vcfbench.reports.typography import in_unicode, marked_up, marked_up_in_svg

THIN = "\u202f"


@pytest.mark.parametrize(
    ("plain", "set_"),
    [
        ("rate / (deg/s)", "rate / (°/s)"),
        ("12.5 mV/(deg/s)", f"12.5{THIN}mV/(°/s)"),
        ("150.1 (deg/s)/V", f"150.1{THIN}(°/s)/V"),
        ("100 deg/s^2", f"100{THIN}°/s²"),
        ("37.9 deg", "37.9°"),
        ("0.299 59(28) deg", "0.299 59(28)°"),
        ("-12.541 60(30) mV/(deg/s)", f"-12.541 60(30){THIN}mV/(°/s)"),
        ("latitude / deg", "latitude / °"),
        ("deg", "°"),
        ("23.4 degC", f"23.4{THIN}°C"),
        ("0.2 deg/sqrt(h)", f"0.2{THIN}°/√h"),
        ("5 uV", f"5{THIN}µV"),
        ("95 %", f"95{THIN}%"),
        ("Omega_z / (deg/s)", "Ω_z / (°/s)"),
        ("17 rates, 10 readings", "17 rates, 10 readings"),
        ("10 Volts of 3 deg_s, 2 ways", "10 Volts of 3 deg_s, 2 ways"),
        ("degrees and k_vc and turntable.bias_deg_s", "degrees and k_vc and turntable.bias_deg_s"),
        ("8 s of 3 A and 2 K", f"8{THIN}s of 3{THIN}A and 2{THIN}K"),
        ("1 a day", "1 a day"),
    ],
)
def test_units(plain: str, set_: str) -> None:
    assert in_unicode(plain) == set_


def test_names_have_their_index_and_nothing_else_is_markup() -> None:
    assert marked_up("V_Vc = <b>, K_Vc & Omega_z", escaped) == (
        "<i>V</i><sub>Vc</sub> = &lt;b&gt;, <i>K</i><sub>Vc</sub> &amp; <i>Ω</i><sub>z</sub>"
    )
    assert marked_up("my_V_Vc V_Vc_2 --V_Vc", escaped) == "my_V_Vc V_Vc_2 --V_Vc"
    assert marked_up_in_svg("V_Vc / V") == 'V<tspan dy="2" font-size="75%">Vc</tspan><tspan dy="-2"> / V</tspan>'
    assert marked_up_in_svg("rate of K_Vc") == 'rate of K<tspan dy="2" font-size="75%">Vc</tspan>'


def test_what_is_verbatim_stays_so_in_every_form() -> None:
    table = Table([Column("V_Vc", "deg/s", align="left", verbatim=True)], [["run --note 'V_Vc 5 deg/s'"]])
    report = Report([Text("V_Vc 5 deg/s"), Text("V_Vc 5 deg/s", verbatim=True), table])
    page, text = html_of(report), markdown_of(report, lambda _, number: str(number))
    assert page.count("V_Vc 5 deg/s") == 2
    assert page.count("<i>V</i><sub>Vc</sub> 5\u202f°/s") == 1
    assert text.count("V_Vc 5 deg/s") == 3
