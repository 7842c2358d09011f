"""The default setup of the DSO7104B: every setting, by the short forms of its command."""

from __future__ import annotations

from typing import Any

CHANNELS = (1, 2, 3, 4)

_CHANNEL = {
    "RANG": 40.0,
    "OFFS": 0.0,
    "COUP": "DC",
    "IMP": "ONEM",
    "BWL": False,
    "INV": False,
    "UNIT": "VOLT",
    "PROB": 1.0,
    "SKEW": 0.0,
    "STYP": "SING",
    "VERN": False,
    "PROT": "NORM",
}
_HORIZONTAL = {
    "TIM:MODE": "MAIN",
    "TIM:RANG": 1e-3,
    "TIM:POS": 0.0,
    "TIM:REF": "CENT",
    "TIM:VERN": False,
    "WIND:POS": 0.0,
    "WIND:RANG": 1e-4,
    "ACQ:TYPE": "NORM",
    "ACQ:MODE": "RTIM",
    "ACQ:COUN": 8,
    "ACQ:COMP": 100,
    "SEGM:COUN": 2,
    "SEGM:IND": 1,
}
_TRIGGER = {
    "TRIG:MODE": "EDGE",
    "TRIG:SWE": "AUTO",
    "TRIG:SOUR": "CHAN1",
    "TRIG:SLOP": "POS",
    "TRIG:COUP": "DC",
    "TRIG:HFR": False,
    "TRIG:NREJ": False,
    "TRIG:HOLD": 60e-9,
    "GLIT:SOUR": "CHAN1",
    "GLIT:QUAL": "LESS",
    "GLIT:POL": "POS",
    "GLIT:LESS": 30e-9,
    "GLIT:RANG": (30e-9, 10e-9),
    "GLIT:GRE": 20e-9,
    "TV:SOUR": "CHAN1",
    "TV:MODE": "ALIN",
    "TV:STAN": "NTSC",
    "TV:POL": "NEG",
    "TV:LINE": 1,
}
"""Thresholds of time beside the edge's are not known for the default setup."""
_MEASUREMENT = {
    "MEAS:SOUR": ("CHAN1", "NONE"),
    "MEAS:THR": ("STAN", 90.0, 50.0, 10.0),
    "MEAS:DEL": (1, 1),
    "MEAS:STAT": "ON",
    "MEAS:SHOW": False,
}
_FUNCTION = {
    "FUNC:DISP": False,
    "FUNC:OPER": "ADD",
    "FUNC:SOUR1": "CHAN1",
    "FUNC:SOUR2": "CHAN2",
    "FUNC:RANG": None,
    "FUNC:OFFS": None,
    "FUNC:WIND": "HANN",
    "FUNC:CENT": None,
    "FUNC:SPAN": None,
    "GOFT:OPER": "ADD",
    "GOFT:SOUR1": "CHAN1",
    "GOFT:SOUR2": "CHAN2",
}
"""None follows sources and time base until it is set."""
_REST = {
    "WAV:SOUR": "CHAN1",
    "WAV:FORM": "BYTE",
    "WAV:UNS": True,
    "WAV:BYT": "MSBF",
    "WAV:POIN": 1000,
    "WAV:MODE": "NORM",
    "WAV:VIEW": "MAIN",
    "AUT:CHAN": "ALL",
    "DISP:VECT": True,
    "DISP:LAB": False,
    "DISP:PERS": "MIN",
    "HARD:AREA": "SCR",
    "HARD:FACT": False,
    "HARD:FFE": False,
    "HARD:FORM": "PNG",
    "HARD:INKS": True,
    "HARD:LAY": "PORT",
    "HARD:PAL": "NONE",
    "SYST:LOCK": False,
    "SYST:PROT": False,
}
_ACCESSORIES = {
    "EXT:BWL": False,
    "EXT:RANG": 8.0,
    "EXT:UNIT": "VOLT",
    "EXT:PROB": 1.0,
    "EXT:STYP": "SING",
    "DISP:SOUR": "PMEM0",
    "SAVE:FIL": "",
    "SAVE:PWD": "",
    "SAVE:IMAG:AREA": "GRAT",
    "SAVE:IMAG:FACT": False,
    "SAVE:IMAG:FORM": "NONE",
    "SAVE:IMAG:INKS": True,
    "SAVE:IMAG:PAL": "COL",
    "SAVE:WAV:FORM": "NONE",
    "SAVE:WAV:LENG": 1000,
    "REC:FIL": "",
    "REC:PWD": "",
}
"""The external trigger input and files, whose own is unverified."""


def default_setup() -> dict[str, Any]:
    """Return the setup after *RST."""
    setup: dict[str, Any] = _HORIZONTAL | _TRIGGER | _MEASUREMENT | _FUNCTION | _REST | _ACCESSORIES
    setup |= {f"LEV:{source}": 0.0 for source in (*(f"CHAN{channel}" for channel in CHANNELS), "EXT", "LINE")}
    for channel in CHANNELS:
        own = {**_CHANNEL, "DISP": channel == 1, "LAB": str(channel)}
        setup |= {f"CHAN{channel}:{key}": value for key, value in own.items()}
    return setup
