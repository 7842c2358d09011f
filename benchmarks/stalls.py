"""How long one client of a served desk can hold the others up, measurement by measurement.

A server looks at its other clients between the calls of a device, and between the slices of what is worked out in
slices. So every measurement of each meter and oscilloscope is asked, in this process, of every waveform of each
generator, and the longest call or slice is noted, in processor time of its thread. The bar is 20 ms.
`stalls.py WORD...` asks only cells whose names hold the words, and prints each, and how many were not answered.
`stalls.py --served [TIMES]` asks a served desk for the longest of them, each so many times (3), and all the while the
supply for its `*IDN?`, which it asks for first while nobody else does. The longest answer of each time is noted, and
the smallest of these is reported: what else the machine does comes once, what the server does comes each time.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import time
from contextlib import ExitStack
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np
from measure import Figure, report
from neighbours import waits
from simrack.attendance import AttendedClock
from simrack.clock import VirtualClock
from simrack.instruments.agilent33220a import Agilent33220ATwin
from simrack.instruments.dso7104b import Dso7104BTwin
from simrack.instruments.hp34401a import Hp34401ATwin
from simrack.instruments.infiniivision import InfiniiVisionXTwin
from simrack.instruments.keithley import Keithley2000Twin, KeithleyDMM6500Twin
from simrack.instruments.trueform import TrueformTwin
from simrack.instruments.truevolt import Keysight34461ATwin, Keysight34465ATwin
from simrack.serve.server import NEEDED_LATER
from simrack.wired import WiredWorld
from tcp import connected, port_of

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Iterator

    from simrack.scpi import ScpiTwin

BAR_MS = 20.0
LONGEST_S = 30.0
"""Bench time after which an answer is given up."""

SHAPES = {
    "sine 1 kHz": "APPL:SIN 1E3,2,0",
    "sine 1 mHz": "APPL:SIN 1E-3,2,0",
    "sine 20 MHz": "APPL:SIN 20E6,2,0",
    "square 1 kHz": "APPL:SQU 1E3,2,0",
    "square 20 MHz": "APPL:SQU 20E6,2,0",
    "ramp 200 kHz": "APPL:RAMP 200E3,2,0",
    "pulse 1 kHz": "APPL:PULS 1E3,2,0",
    "pulse 5 MHz": "APPL:PULS 5E6,2,0",
    "noise": "APPL:NOIS DEF,2,0",
    "arbitrary 1 MHz": "APPL:USER 1E6,2,0",
    "level": "APPL:DC DEF,DEF,1",
}
MODULATIONS = {
    "": "",
    "AM 10 Hz": "AM:INT:FREQ 10;:AM:STAT ON",
    "AM 20 kHz": "AM:INT:FREQ 20E3;:AM:STAT ON",
    "FM 1 Hz by 10 Hz": "FM:DEV 1;:FM:STAT ON",
    "FM 10 kHz by 20 kHz": "FM:INT:FREQ 20E3;:FM:DEV 10E3;:FM:STAT ON",
    "PM 10 Hz": "PM:STAT ON",
    "PM 20 kHz": "PM:INT:FREQ 20E3;:PM:STAT ON",
    "PM by a square": "PM:INT:FUNC SQU;:PM:INT:FREQ 2E3;:PM:STAT ON",
    "PWM 20 kHz": "PWM:INT:FREQ 20E3;:PWM:STAT ON",
    "FSK 10 Hz": "FSK:FREQ 200E3;:FSK:STAT ON",
    "FSK 100 kHz": "FSK:FREQ 100;:FSK:INT:RATE 100E3;:FSK:STAT ON",
    "sweep": "FREQ:STAR 100;:FREQ:STOP 200E3;:SWE:TIME 0.01;:SWE:STAT ON",
    "sweep 1 s": "FREQ:STAR 1;:FREQ:STOP 5E6;:SWE:TIME 1;:SWE:SPAC LOG;:SWE:STAT ON",
    "burst": "BURS:NCYC 3;:BURS:INT:PER 0.01;:BURS:STAT ON",
    "burst 20 us": "BURS:NCYC 3;:BURS:INT:PER 20E-6;:BURS:STAT ON",
}
FIXED = ("noise", "level")
"""What nothing modulates."""
GENERATORS = {"33220A": Agilent33220ATwin, "33522B": TrueformTwin.of_model("33522B", 30e6)}
_MEASURED = tuple(f"MEAS:{each}?" for each in ("VOLT:DC", "VOLT:AC", "FREQ", "PER"))
_SLOWLY = ("CONF:FREQ;:FREQ:VOLT:RANG:AUTO ON;:FREQ:APER 1;:{};:READ?", "CONF:VOLT:AC;:{};:READ?")
_SCOPE = (
    *(":MEAS:FREQ? CHAN1", ":MEAS:VPP? CHAN1", ":MEAS:COUN? CHAN1", ":AUT;*OPC?"),
    *(f":TIM:RANG {span};:DIG CHAN1;*OPC?;:MEAS:FREQ?;:MEAS:VRMS?;:MEAS:RIS?" for span in ("5E-9", "1E-3", "1")),
    ":ACQ:TYPE AVER;COUN 64;:TIM:RANG 1E-3;:DIG CHAN1;*OPC?;:WAV:DATA?",
    ":TIM:RANG 1E-3;:CHAN1:COUP AC;BWL ON;:DIG CHAN1;*OPC?;:WAV:POIN:MODE MAX;:WAV:POIN 8000000;:WAV:DATA?",
    *(
        f":ACQ:TYPE {each};:TIM:RANG 1E-2;:DIG CHAN1;*OPC?;:MEAS:VPP?;:MEAS:VTOP?;:MEAS:PER?"
        for each in ("PEAK", "HRES")
    ),
    ":DIG CHAN1;*OPC?;:DISP:DATA? BMP8",
)
_CLASSIC = (*_MEASURED, *(each.format("DET:BAND 3") for each in _SLOWLY))
_TRUEVOLT = (*_MEASURED, *(each.format("VOLT:AC:BAND 3") for each in _SLOWLY))
METERS = {
    "34401A": (Hp34401ATwin, _CLASSIC),
    "34461A": (Keysight34461ATwin, _TRUEVOLT),
    "34465A": (Keysight34465ATwin, _TRUEVOLT),
    "2000": (Keithley2000Twin, _MEASURED),
    "DMM6500": (KeithleyDMM6500Twin, _MEASURED),
}
SCOPES = {"DSO7104B": (Dso7104BTwin, _SCOPE), "DSOX3024A": (InfiniiVisionXTwin, _SCOPE)}


class Watched:
    """A device whose calls are timed as a server makes them."""

    def __init__(self, device: ScpiTwin) -> None:
        self.device = device
        self.longest_s = 0.0
        device.engine.hand_over = lambda: None

    def timed(self, call: Callable[..., Any], *arguments: Any, **more: Any) -> Any:
        """Call, and keep how long it took if that is the longest."""
        begun = time.thread_time()
        try:
            return call(*arguments, **more)
        finally:
            self.longest_s = max(self.longest_s, time.thread_time() - begun)

    def ask(self, message: str, clock: AttendedClock, most_s: float = LONGEST_S) -> bytes:
        """Send a message and wait for its answer, as a server does."""
        until_s, answer, ended = clock.now() + most_s, b"", False
        self.timed(self.device.write, message.encode() + b"\n", end=True)
        while not ended and clock.now() < until_s:
            while self.device.engine.working:
                self.timed(self.device.engine.work)
            part, ended = self.timed(self.device.read, 1 << 20)
            answer += part
            due = None if part else self.timed(self.device.wake_at)
            if not part and not self.device.engine.working:
                if due is None:
                    break
                clock.sleep_until(min(due, until_s))
        return answer


def cells(words: tuple[str, ...] = ()) -> Iterator[tuple[str, float, bytes]]:
    """Yield the name of each cell, its longest piece, s, and its answer."""
    for module in NEEDED_LATER:  # as a server does before it begins
        import_module(module)
    gc.freeze()
    for generator, made in GENERATORS.items():
        for shape, apply in SHAPES.items():
            for modulation, modulate in MODULATIONS.items():
                if modulation and shape in FIXED:
                    continue
                for observer, (model, questions) in (METERS | SCOPES).items():
                    for question in questions:
                        name = " ".join(filter(None, (generator, shape, modulation, observer, question)))
                        if all(word in name for word in words):
                            found = cell(made, apply, modulate, model, question)
                            if found is not None:
                                yield name, *found


def cell(made: Any, apply: str, modulate: str, model: Any, question: str) -> tuple[float, bytes] | None:
    """Return the longest piece of a question, s, and its answer; None where the generator refuses the signal."""
    clock = AttendedClock(VirtualClock())
    world = WiredWorld(clock)
    ideal, meter = model.errors_class.none(), model in {each for each, _ in METERS.values()}
    observer = Watched(model(world, node="input", errors=ideal) if meter else model(world, {1: "input"}, ideal))
    generator = made(world, made.errors_class.none(), node="input")
    clock.attend(generator, observer.device)
    for each in (apply, modulate):
        generator.write(each.encode() + b"\n", end=True)
        clock.sleep_until(clock.now() + 0.3)
    if generator.engine.errors.pop()[0]:
        return None
    generator.write(b"OUTP ON\n", end=True)
    clock.sleep_until(clock.now() + 1.0)
    answer = observer.ask(question, clock)
    return observer.longest_s, answer


SERVED = (
    ("APPL:SIN 20E6,2,0;:FM:DEV 1;:FM:STAT ON", "multimeter", "MEAS:FREQ?"),
    ("APPL:SQU 1E3,2,0;:BURS:NCYC 3;:BURS:INT:PER 0.01;:BURS:STAT ON", "multimeter", "MEAS:VOLT:AC?"),
    ("APPL:SQU 10,2,0", "multimeter", "MEAS:VOLT:AC?"),
    *(("APPL:SIN 20E6,2,0", "oscilloscope", each) for each in _SCOPE),
)
"""What a neighbour waits for longest: the generator's signal, who is asked, and what."""


def served(times: int = 3) -> list[Figure]:
    """Return how long the supply's *IDN? takes while nobody else is there, and while each of the longest is asked."""
    with ExitStack() as stack:
        command = [sys.executable, "-m", "simrack", "serve", "--json", "--speed", "max"]
        process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(process.terminate)
        assert process.stdout is not None  # noqa: S101
        said = json.loads(process.stdout.readline())
        roles = ("power", "generator", "multimeter", "oscilloscope")
        wires = {role: stack.enter_context(connected(port_of(said, role))) for role in roles}
        found = [least("nobody else", [waits([(wires["power"], b"*IDN?\n")], 3.0) for _ in range(times)])]
        for signal, role, question in SERVED:
            message, took = f"*RST;:{question.removeprefix(':')}\n".encode(), list[Any]()
            for _ in range(times):
                asked(wires["generator"], f"*RST;:{signal};:OUTP ON\n".encode())  # else the answer is known already
                asker, parts = Thread(target=asked, args=(wires[role], message)), list[Any]()
                asker.start()
                while not parts or asker.is_alive():
                    parts.append(waits([(wires["power"], b"*IDN?\n")], 0.02))
                took.append(np.concatenate(parts))
            found.append(least(f"{signal}, {role} {question}", took))
    return found


def asked(wire: socket.socket, message: bytes) -> None:
    """Send a message, and wait until all that it asks for is here."""
    wire.sendall(message + b"*OPC?\n")
    answer = b""
    while not (answer == b"1\n" or answer.endswith(b"\n1\n")):
        answer = answer[-2:] + wire.recv(1 << 20)


def least(name: str, took: list[Any]) -> Figure:
    longest_ms = 1e3 * min(float(each.max()) for each in took)
    return report(Figure(f"stalls: beside {name}, longest, least of {len(took)}", longest_ms, "ms", bar=BAR_MS))


def figures(words: tuple[str, ...] = ("33220A sine 20 MHz FM", "34401A")) -> list[Figure]:
    longest = max(seconds if answer else LONGEST_S for _, seconds, answer in cells(words))
    name = f"stalls: longest piece of {' '.join(words)}"
    return [report(Figure(name, 1e3 * longest, "ms", bar=BAR_MS, gross=10 * BAR_MS))]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--served"]:
        served(*map(int, sys.argv[2:]))
        sys.exit()
    silent = 0
    for cell_, seconds_, answer_ in cells(tuple(sys.argv[1:])):
        print(f"{1e3 * seconds_:8.1f} ms  {cell_}  {answer_[:60]!r}", flush=True)
        silent += not answer_
    sys.exit(f"{silent} were not answered" if silent else 0)
