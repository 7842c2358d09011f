"""Words of the DMM6500 for functions that digitise.

Source: pages of the DMM7510's Reference Manual, which has the same words, and users' code for both. Unverified: ranges
and defaults but for rate and aperture, the error of an aperture that is longer than the interval (-221), and that
another rate takes it away. The aperture, the analog trigger and the unit are kept, and change nothing: a sample is what
is there amid its interval.
"""

from __future__ import annotations

from functools import partial

from simrack import scpi
from simrack.instruments.keithley.reading_buffer import SAMPLE_RATES_HZ, BufferingMeter

ROWS = scpi.Rows()

_NR3 = "{:G}".format
_LEVEL = scpi.Number(limits=scpi.Limits(-1000.0, 1000.0))
_RANGES = {"VOLT": (0.1, 1.0, 10.0, 100.0, 1000.0), "CURR": (1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.0)}


@ROWS.attribute("[SENSe:]DIGitize:FUNCtion[:ON]", scpi.Text(), "digitizing")
def _choose(meter: BufferingMeter, text: str) -> None:
    name = {"VOLTAGE": "VOLT", "CURRENT": "CURR"}.get(text.strip().upper(), text.strip().upper())
    if name not in meter.samplings:
        raise scpi.ScpiError(-224)
    meter.choose_digitizing(name)


ROWS.append(
    scpi.attribute(
        "[SENSe:]DIGitize:COUNt",
        scpi.Integer(limits=scpi.Limits(1, 55_000_000, 100)),
        "digitize_count",
        scpi.bare_integer,
    )
)


def _set_rate(name: str, meter: BufferingMeter, rate_hz: int) -> None:
    own = meter.samplings[name]
    own.rate_hz, own.aperture_s = float(rate_hz), None


def _set_aperture(name: str, meter: BufferingMeter, aperture_s: float) -> None:
    own = meter.samplings[name]
    if aperture_s * own.rate_hz > 1.0 + 1e-9:
        raise scpi.ScpiError(-221)
    own.aperture_s = aperture_s or None


def _set_range(name: str, meter: BufferingMeter, most: float) -> None:
    meter.samplings[name].range = next(each for each in _RANGES[name] if abs(most) <= each)


def _aperture_s(name: str, meter: BufferingMeter) -> float:
    own = meter.samplings[name]
    return own.aperture_s or 1.0 / own.rate_hz


for _name, _header in (("VOLT", "VOLTage"), ("CURR", "CURRent")):
    _root, _own = f"[SENSe:]DIGitize:{_header}", f"samplings[{_name}]"
    _most = _RANGES[_name][-1]
    ROWS += [
        scpi.attribute(
            f"{_root}:SRATe",
            scpi.Integer(limits=SAMPLE_RATES_HZ),
            f"{_own}.rate_hz",
            scpi.bare_integer,
            do=partial(_set_rate, _name),
        ),
        scpi.attribute(
            f"{_root}:RANGe[:UPPer]",
            scpi.Number(limits=scpi.Limits(-_most, _most)),
            f"{_own}.range",
            _NR3,
            do=partial(_set_range, _name),
        ),
        scpi.Command(
            f"{_root}:APERture",
            (scpi.Number(unit="S", limits=scpi.Limits(1e-6, 1e-3, 0.0), words={"AUTO": 0.0}),),
            do=partial(_set_aperture, _name),
            query=partial(_aperture_s, _name),
            reply=_NR3,
            reads=True,
        ),
        scpi.remembered(f"{_root}:ATRigger:MODE", scpi.Choice(("OFF", "EDGE", "PULSe", "WINDow")), "OFF"),
        scpi.remembered(f"{_root}:ATRigger:EDGE:LEVel", _LEVEL, 0.0, _NR3),
        scpi.remembered(f"{_root}:ATRigger:EDGE:SLOPe", scpi.Choice(("RISing", "FALLing")), "RIS"),
    ]
ROWS.append(
    scpi.attribute(
        "[SENSe:]DIGitize:VOLTage:INPutimpedance",
        scpi.Choice(("MOHM10", "AUTO")),
        "samplings[VOLT].high_impedance",
        lambda high: "AUTO" if high else "MOHM10",
        convert=lambda word: word == "AUTO",
    )
)
