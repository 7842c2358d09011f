"""Makes the kit: the program, with the questions of every model that is simulated, in one file.

Questions come from the command tables of the simulated instruments, those rows that say that they only read. What is
set is what our own drivers say to a simulated instrument, with their deadlines.
"""

import base64
import json
import re
import zlib
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.resources import files
from typing import Any

from simrack.device import Device
from simrack.models import MODELS as TWINS
from simrack.plan import plan_of
from simrack.rack import Rack
from simrack.scpi import CommandTable
from simrack.scpi.errors import ERROR_WORDS
from simrack.scpi.mnemonics import Mnemonic
from simrack.scpi.parameters import Choice

from vcfbench.clock import Clock, Deadline, VirtualClock
from vcfbench.drivers.scpi_instrument import VisaSettings
from vcfbench.drivers.session import Session
from vcfbench.drivers.wire import Interface
from vcfbench.errors import BenchError, DeadlineExceeded
from vcfbench.models import driver_of, find_model
from vcfbench.testing.kit import program

_DOES = {
    "supply": "each of its outputs gives 1 V and 50 mA at most",
    "generator": "it gives 0.2 V peak to peak",
    "multimeter": "it measures DC voltage",
    "oscilloscope": "it takes a record",
}


class TwinWire:
    """A wire to a simulated instrument whose time jumps; it notes what is said over it."""

    interface: Interface = "gpib"

    def __init__(self, device: Device, clock: Clock) -> None:
        self.said: list[tuple[str, float, float]] = []
        """Messages; how long after what came before it, s; how long an answer may take, s."""
        self._device, self._clock = device, clock
        self._free_s = clock.now()

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        now = self._clock.now()
        for message in data.decode("ascii").split("\n"):
            if message:
                self.said.append((message, round(now - self._free_s, 3), round(deadline.expires_s - now, 3)))
        self._device.write(data, end=True)
        self._free_s = now

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return what comes next, at its time."""
        while True:
            data, end = self._device.read(1 << 20)
            if data:
                self._free_s = self._clock.now()
                return data, end
            wake_s = self._device.wake_at()
            self._clock.sleep_until(deadline.expires_s if wake_s is None else min(wake_s, deadline.expires_s))
            if deadline.expired():
                raise DeadlineExceeded("no answer")

    def pending(self) -> bytes:
        """Return nothing: it says nothing by itself."""
        return b""

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear."""
        self._device.clear()

    def close(self) -> None:
        """Do nothing."""


def twin(model: str) -> tuple[Device, Clock]:
    """Return a simulated instrument of its own, and its clock."""
    rack = Rack.build(VirtualClock(), plan_of([model]))
    return rack.devices[model], rack.world.clock


def _opened(model: str) -> tuple[Session, TwinWire]:
    device, clock = twin(model)
    wire = TwinWire(device, clock)
    return Session(wire, name=model, resource="GPIB", clock=clock, timeout_s=VisaSettings().timeout_s), wire


def questions(table: CommandTable) -> list[str]:
    """Return the queries of a table that only read and take no parameter, in short form."""
    asked = []
    for row in table.commands:
        if row.reads and row.query and not any(each.required for each in row.query_parameters or ()):
            headers = (":".join(map(_spelt, words)) for words, optional in row.parts() if not optional)
            asked.append(f"{':'.join(headers)}?")
    first = ["*IDN?"]
    return [*first, *(each for each in dict.fromkeys(asked) if each not in first)]


def _spelt(word: Mnemonic) -> str:
    low, high = word.suffixes or (1, 1)
    return f"{word.short}{low}" if high > low or low > 1 else word.short


def words(table: CommandTable, answers: Iterator[str]) -> list[str]:
    """Return all words of a table, of its parameters, of the standard's errors, and in the answers of its twin."""
    parameters = (each for row in table.commands for each in row.parameters if isinstance(each, Choice))
    choices = (word for each in parameters for word in each.mnemonics)
    named = (word for row in table.commands for part, _ in row.parts() for word in part)
    spelt = {spelling for word in (*choices, *named) for spelling in word.spellings}
    free = " ".join((*ERROR_WORDS.values(), *answers)).upper()
    return sorted(spelt | {each for each in re.split(r"[^A-Z_-]+", free) if each})


def drives(model: str) -> tuple[list[tuple[str, float, float]], list[str]]:
    """Return what the driver says when it sets and measures within limits, and the words by which it switches off."""
    row = find_model(model)
    if row is None:
        raise KeyError(model)
    session, wire = _opened(model)
    driver = driver_of(row).opened(session, VisaSettings())
    use_within_limits(driver, TWINS[model].kind)
    driver.make_safe(session.deadline(30.0))
    own = list(wire.said)
    wire.said.clear()
    driver.command_safe()
    return own, [message for message, _, _ in wire.said]


def use_within_limits(driver: Any, kind: str) -> None:
    """Set and measure with a driver of a kind of instrument: little enough for anybody's bench."""
    if kind == "supply":
        for output, sign in (("P6V", 1.0), ("P25V", 1.0), ("N25V", -1.0)):
            driver.configure_output(output, sign, 0.05)
        driver.enable_outputs()
        for output in ("P6V", "P25V", "N25V"):
            driver.measure_voltage_v(output)
            driver.measure_current_a(output)
        driver.disable_outputs()
    elif kind == "generator":
        driver.configure_sine(1000.0, 0.2)
        driver.enable_output()
        driver.output_enabled()
        driver.disable_output()
        driver.configure_dc(0.1)
        driver.set_dc(0.05)
    elif kind == "multimeter":
        driver.configure_dc_voltage(10.0, 1.0)
        driver.read_voltage_v()
        driver.configure_dc_voltage(10.0, 10.0)
        driver.read_voltage_v()
    else:
        driver.configure_channel(1, 1.0)
        driver.configure_timebase(1e-3)
        driver.configure_trigger(1)
        driver.acquire(1)
        with suppress(BenchError):  # of nothing no frequency is measured
            driver.measure_amplitude_v(1)


@cache
def scripts() -> dict[str, program.Script]:
    """Return the questions of all models, as the program has them."""
    made: dict[str, program.Script] = {}
    for model, row in TWINS.items():
        table = row.load().table
        own, safe = drives(model)
        asked = questions(table)
        made[model] = {
            "reads": asked,
            "timeout_s": VisaSettings().timeout_s,
            "words": words(table, answers(model, asked)),
            "does": _DOES[row.kind],
            "drives": own,
            "safe": safe,
        }
    return made


def answers(model: str, asked: list[str]) -> Iterator[str]:
    """Yield what a simulated instrument answers to all but the first, which is its identity."""
    session, _ = _opened(model)
    for question in asked[1:]:
        with suppress(BenchError):  # some have no answer until something else is set
            yield session.query(question)


def written() -> str:
    """Return the kit: one file that needs PyVISA alone."""
    text = files("vcfbench.testing.kit").joinpath("program.py").read_text("utf-8")
    packed = base64.b85encode(zlib.compress(json.dumps(scripts()).encode(), 9)).decode("ascii")
    filled = text.replace('\nPACKED = ""\n', f'\nPACKED = r"{packed}"  # noqa: E501\n')
    if packed not in filled:
        raise ValueError("the program has no place for its questions")
    return filled
