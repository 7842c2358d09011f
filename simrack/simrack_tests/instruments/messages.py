"""Units of messages for each SCPI model, and what each is answered: for tests that join them at will."""

from __future__ import annotations

from typing import NamedTuple

from hypothesis import strategies as st

_NUMBER = r"[-+]?\d[\d.]*(E[-+]\d+)?"


class Unit(NamedTuple):
    """One unit of a message.

    Args:
        text: what is sent, from the root.
        answer: regular expression of its answer, None for a command.
        error: the error that it queues, 0 for none.
    """

    text: str
    answer: str | None = None
    error: int = 0

    @property
    def ends(self) -> bool:
        """Whether the rest of the message is thrown away (a command error)."""
        return -199 <= self.error <= -100


UNITS: dict[str, tuple[Unit, ...]] = {
    "multimeter": (
        Unit("*OPC?", "1"),
        Unit(":SYST:VERS?", r"1991\.0"),
        Unit(":TRIG:SOUR?", "IMM"),
        Unit(":VOLT:RANG?", _NUMBER),
        Unit(":CONF?", '"[^"]*"'),
        Unit(":VOLT:RANG 10"),
        Unit(":FUNC 'VOLT'"),
        Unit("*WAI"),
        Unit(":MEAS:VOLT? 10,MAX", _NUMBER),
        Unit(":MEAS:VOLT:AC?", _NUMBER),
        Unit(":MEAS:RES?", _NUMBER),
        Unit(":READ?", _NUMBER),
    ),
    "power": (
        Unit("*OPC?", "1"),
        Unit(":SYST:VERS?", r"1995\.0"),
        Unit(":INST?", "P6V|P25V|N25V"),
        Unit(":VOLT?", _NUMBER),
        Unit(":APPL? P6V", '"[^"]*"'),
        Unit(":VOLT 1"),
        Unit(":INST P25V"),
        Unit("*WAI"),
        Unit(":MEAS:VOLT? P25V", _NUMBER),
        Unit(":MEAS:CURR? P6V", _NUMBER),
    ),
    "rate_source": (
        Unit("*OPC?", "1"),
        Unit(":SYST:VERS?", r"1999\.0"),
        Unit(":FUNC?", "SIN|SQU"),
        Unit(":APPL?", '"[^"]*"'),
        Unit(":FREQ 2000"),
        Unit(":VOLT:OFFS 0.1"),
        Unit(":FUNC SQU"),
        Unit("*WAI"),
        Unit(":VOLT:OFFS?", _NUMBER),
        Unit("*TST?", r"\+0"),
    ),
    "oscilloscope": (
        Unit("*OPC?", "1"),
        Unit(":TRIG:SWE?", "AUTO"),
        Unit(":CHAN1:COUP?", "DC"),
        Unit(":RUN"),
        Unit(":STOP"),
        Unit(":DIG CHAN1"),
        Unit("*WAI"),
        Unit(":MEAS:VMAX? CHAN1", _NUMBER),
        Unit(":MEAS:VPP? CHAN1", _NUMBER),
        Unit("*TST?", r"\+?0"),
    ),
}
"""What each model answers at once, what takes it time, and commands of both kinds."""

MISTAKES: dict[str, tuple[Unit, ...]] = {
    "multimeter": (Unit(":FOO", error=-113), Unit(":VOLT:RANG", error=-109), Unit(":SAMP:COUN 0", error=-222)),
    "power": (Unit(":FOO", error=-113), Unit(":VOLT", error=-109), Unit(":VOLT 1000", error=-222)),
    "rate_source": (Unit(":FOO?", error=-113), Unit(":FREQ", error=-109), Unit("*SAV 9", error=-222)),
    "oscilloscope": (Unit(":FOO", error=-113), Unit(":CHAN1:COUP", error=-109)),
}


def messages(role: str) -> st.SearchStrategy[list[Unit]]:
    """Messages without mistakes."""
    return st.lists(st.sampled_from(UNITS[role]), min_size=1, max_size=7)


def wrong_messages(role: str) -> st.SearchStrategy[list[Unit]]:
    """Messages with a mistake somewhere, or several."""
    return st.lists(st.sampled_from(UNITS[role] + MISTAKES[role]), min_size=1, max_size=7)


def text(units: list[Unit]) -> str:
    """Return the message."""
    return ";".join(unit.text for unit in units)


def executed(units: list[Unit]) -> list[Unit]:
    """Return what an instrument goes through: up to the first command error."""
    ends = next((index for index, unit in enumerate(units) if unit.ends), len(units))
    return units[: ends + 1]


def answers(units: list[Unit]) -> str | None:
    """Return the regular expression of the answer: one line, in order, joined by semicolons; None for none."""
    parts = [f"(?:{unit.answer})" for unit in executed(units) if unit.answer is not None]
    return ";".join(parts) or None


def errors(units: list[Unit]) -> list[int]:
    """Return the errors that are queued, in order."""
    return [unit.error for unit in executed(units) if unit.error]
