"""Records how your instruments answer, for vcfbench (its simulated instruments and drivers were written from manuals).

    pip install pyvisa pyvisa-py       or pyvisa alone, with the VISA library of your instruments' maker
    python vcfbench-kit.py             asks which instruments are there, and writes vcfbench-bundle.trace

First it only reads: identity, settings, status registers. Nothing is set, measured, saved or switched by that; an
instrument beeps where it does not know a question. Only if you say so twice, an instrument is then set: back to its
power-on settings (*RST), a supply to 1 V and 50 mA at most, a generator to 0.2 V; disconnect its outputs first. It is
switched off at the end, also after Ctrl-C and after an error.

What is written: each message, each answer, their times. What is not: serial numbers, addresses, LAN settings, labels,
names of files, texts of calibration, date and time. By an allow-list: of an answer only numbers and the words of the
model's manual are kept, of any other text each letter is an X and each digit a 0. The file is text: read it first.
"""

from __future__ import annotations

import argparse
import base64
import json
import re
import signal
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

HEADER = "# vcfbench trace 1"
PACKED = ""
"""The questions by model; made of the tables of vcfbench by `vcfbench kit write`."""
ERROR_QUESTION = "SYST:ERR?"
LATER = 3.0
"""How much longer than our driver's deadline an answer is waited for, as a factor: a late one is to be seen as late."""
READ_S = 2.0
"""How long an answer to what only reads is waited for, s: what is not known is not answered."""
QUIET_MS = 200
"""Silence after which nothing more comes on a stream, which has no device clear, ms."""
MOST_SILENT = 3
"""Unanswered questions in a row after which an instrument is left alone."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(E[+-]?\d{1,3})?", re.IGNORECASE)
_EXACT_DIGITS, _SHORTEST_SERIAL = 5, 2
_IDENTITY, _SERIAL = 4, 2
_CLOCK = re.compile(r"(SYST|CAL)\w*:(DATE|TIME)\b", re.IGNORECASE)
_APART = re.compile(r"([\s,;\"'()@]+)")

Script = dict[str, Any]

COMMON: Script = {
    "reads": ["*IDN?", "*OPT?", "*ESE?", "*SRE?", "*STB?", "SYST:VERS?"],
    "timeout_s": 5.0,
    "words": ["NO", "ERROR"],
}
"""Queries for an instrument of unknown model."""


def scripts() -> dict[str, Script]:
    """Return the questions by model."""
    return json.loads(zlib.decompress(base64.b85decode(PACKED))) if PACKED else {}


def escaped(text: str) -> str:
    """Return text, a character a byte, as printable ASCII without tabs, as vcfbench's traces have it."""
    return text.encode("unicode_escape").decode("ascii")


def model_of(identity: str) -> str:
    """Return the model in an answer to ``*IDN?``, as it is sold."""
    answered = [*identity.split(","), ""][1]
    return answered.strip().upper().removeprefix("MODEL ").replace("-X ", "X")


def blotted(text: str) -> str:
    """Return text whose letters are X and whose digits are 0: its form is left."""
    return re.sub(r"[^\W\d_]", "X", re.sub(r"\d", "0", text))


def masked(question: str, answer: str, words: Sequence[str], serial: str = "") -> str:
    """Return an answer without serial numbers and other marks of its owner.

    Kept are numbers, words of the list (with the number of a channel), and of ``*IDN?`` maker, model and firmware. Not
    kept is a whole number of more than five digits, or any in quotes, date and time, and whatever holds the serial
    number.
    """
    foreign = len(serial) > _SHORTEST_SERIAL
    if question.upper().startswith("*IDN?"):
        fields = answer.split(",")
        whole = len(fields) == _IDENTITY  # else it may be anything
        kept = [whole and index != _SERIAL and not (foreign and serial in each) for index, each in enumerate(fields)]
        return ",".join(each if keep else blotted(each) for each, keep in zip(fields, kept, strict=True))
    if _CLOCK.match(question):
        return blotted(answer)
    allowed, parts, quoted = {word.upper() for word in words}, [], False

    def known(word: str) -> bool:
        stem = word.rstrip("0123456789")
        return word in allowed or (stem in allowed and len(word) - len(stem) == 1)

    for index, part in enumerate(_APART.split(answer)):
        if index % 2:
            quoted ^= part.count('"') % 2 == 1
            parts.append(part)
            continue
        if number := _NUMBER.fullmatch(part):
            keep = number[2] or "." in part or not (quoted or len(part.strip("+-")) > _EXACT_DIGITS)
        else:
            keep = all(known(each) for each in part.upper().split(":") if each)
        parts.append(part if keep and not (foreign and serial.upper() in part.upper()) else blotted(part))
    return "".join(parts)


class Bundle:
    """The file that is written: a trace of vcfbench, a line for each message."""

    def __init__(self, file: TextIO, library: str) -> None:
        self.library = library
        self._file = file
        self._began_s = time.monotonic()
        self.names: list[str] = []
        print(HEADER, file=file)

    def named(self, model: str) -> str:
        """Return a name for an instrument that no other has."""
        known = self.names.count(model)
        self.names.append(model)
        return model if not known else f"{model} {known + 1}"

    def note(self, role: str, kind: str, mark: str, text: str = "") -> None:
        """Write a line, at once: none of it is to be lost."""
        at_s = f"{time.monotonic() - self._began_s:.6f}"
        print(at_s, role, f"{kind}::INSTR", mark, escaped(text), sep="\t", file=self._file, flush=True)


class Silent(Exception):
    """The instrument does not answer any more."""


class Connection:
    """One instrument: everything that is said and heard goes into the bundle."""

    def __init__(self, reopen: Callable[[], Any], bundle: Bundle) -> None:
        self.reopen, self.bundle, self.script = reopen, bundle, COMMON
        self.role, self.serial, self.silent = "", "", 0
        self.connect()

    def connect(self) -> None:
        """Open the connection, or reopen it."""
        self.opened = opened = self.reopen()
        opened.timeout = 5000
        self.kind = str(getattr(opened.interface_type, "name", "instr")).upper()
        self.stream = self.kind == "ASRL" or opened.resource_class == "SOCKET"
        if self.stream:
            opened.read_termination = "\n"

    def begin(self, role: str) -> None:
        """Begin a connection in the bundle."""
        self.role = role
        interface = {"GPIB": "gpib", "USB": "usb", "ASRL": "asrl"}.get(self.kind, "socket" if self.stream else "instr")
        self.bundle.note(role, self.kind, "open", f"{interface} {self.bundle.library}")

    def send(self, message: str) -> None:
        """Send a message."""
        self.bundle.note(self.role, self.kind, ">", message + "\n")
        self.opened.timeout = 5000
        self.opened.write_raw(message.encode("ascii") + b"\n")

    def ask(self, question: str, wait_s: float) -> str | None:
        """Ask, and return the answer, or None where none comes; raises Silent when that is so again and again."""
        self.send(question)
        self.opened.timeout = 1000.0 * wait_s
        try:
            answer = bytes(self.opened.read_raw()).decode("latin-1")
        except Exception as error:
            if "timeout" not in str(error).lower() and not isinstance(error, TimeoutError):
                self.bundle.note(self.role, self.kind, "!", "LinkLost the connection broke")
                raise
            self.bundle.note(self.role, self.kind, "!", "DeadlineExceeded no answer")
            self.silent += 1
            self.clear()
            if self.silent >= MOST_SILENT:
                raise Silent from error
            return None
        self.silent = 0
        words = masked(question, answer, self.script["words"], self.serial)
        self.bundle.note(self.role, self.kind, "<" if self.stream else "<|", words)
        return answer

    def clear(self) -> None:
        """Do a device clear."""
        self.bundle.note(self.role, self.kind, "clear")
        with suppress(Exception):  # not every interface can
            self.opened.clear()
        with suppress(Exception):  # what comes late is no answer to the next question
            self.opened.timeout = QUIET_MS
            while self.stream:
                self.opened.read_raw()


def read(connection: Connection) -> None:
    """Ask all that only reads, and after each question for its error."""
    script, connection.silent = connection.script, 0
    for number, question in enumerate(script["reads"], start=1):
        connection.ask(question, READ_S)
        connection.ask(ERROR_QUESTION, READ_S)
        if number % 50 == 0:
            print(f"  {number} of {len(script['reads'])} questions")


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let nothing interrupt what makes safe."""
    before = {}
    with suppress(ValueError):  # only the first thread may, and only that is interrupted
        before = {each: signal.signal(each, signal.SIG_IGN) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def drive(connection: Connection) -> None:
    """Set and measure as our driver does; at the end, however it comes, the instrument is safe."""
    script = connection.script
    try:
        connection.clear()
        for message, pause_s, deadline_s in script["drives"]:
            time.sleep(pause_s)
            if "?" in message:
                connection.ask(message, LATER * deadline_s)
            else:
                connection.send(message)
    finally:
        with uninterrupted():
            make_safe(connection)


def make_safe(connection: Connection) -> None:
    """Say the words that switch off, and reset; over a new connection if the old one is gone."""
    connection.clear()
    words = (*connection.script["safe"], "*RST")
    try:
        for word in words:
            connection.send(word)
    except Exception:  # whatever a VISA library raises
        connection.connect()
        for word in words:
            connection.send(word)
    if connection.ask("*OPC?", connection.script["timeout_s"]) is None:
        print(f"{connection.role}: no answer after it was switched off: LOOK AT ITS OUTPUTS")


def wanted(names: Sequence[str], ask: Callable[[str], str]) -> list[str]:
    """Ask which of the resources are to be talked to, until each number is one of theirs."""
    choices = {str(number): name for number, name in enumerate(names, start=1)}
    for number, name in choices.items():
        print(f"  {number}  {name}")
    print("Nothing has been sent yet. Which of these shall be asked?")
    while True:
        print("Numbers, or resource names, with spaces between.")
        given = ask("> ").split()
        wrong = [each for each in given if each not in choices and re.fullmatch(r"[\d.,+-]+", each)]
        if not wrong:
            return [choices.get(each, each) for each in given]
        print(f"{' '.join(wrong)}: not in the list")


def versions(library: Any) -> str:
    """Return the names and versions of PyVISA and of the package that is its library."""
    packages = dict.fromkeys(("pyvisa", type(library).__module__.partition(".")[0]))
    return ", ".join(f"{each} {getattr(sys.modules[each], '__version__', '')}".strip() for each in packages)


def talk_to(resource: str, manager: Any, bundle: Bundle, known: dict[str, Script], ask: Callable[[str], str]) -> None:
    """Record one instrument."""
    name, _, speed = resource.partition("@")

    def reopen() -> Any:
        opened = manager.open_resource(name, open_timeout=5000)
        if speed:
            opened.baud_rate = int(speed)
        return opened

    connection = Connection(reopen, bundle)
    try:
        connection.opened.write_raw(b"*IDN?\n")
        identity = bytes(connection.opened.read_raw()).decode("latin-1")
        model = model_of(identity)
        connection.serial = [*identity.split(","), "", ""][2].strip()
        connection.script = known.get(model, COMMON)
        role = bundle.named(model if model in known else "unknown")
        connection.begin(role)
        print(f"{model}: {len(connection.script['reads'])} questions" + ("" if model in known else ", none of its own"))
        read(connection)
        if connection.script.get("drives") and twice(model, connection.script, ask):
            connection.send("*RST")
            connection.begin(f"{role} driven")
            drive(connection)
            print(f"{model}: done, switched off and reset")
    except Silent:
        print(f"{resource}: it no longer answers, and is left alone")
    finally:
        if connection.role:
            bundle.note(connection.role, connection.kind, "close")
        connection.opened.close()


def twice(model: str, script: Script, ask: Callable[[str], str]) -> bool:
    """Ask whether an instrument may be set, and if so once more, by its name."""
    if ask(f"{model}: also set it? It loses its settings, and {script['does']}. y or n: ").strip().lower() != "y":
        return False
    typed = ask(f"Take all leads off the {model}. Then type {model} to go on, anything else leaves it: ")
    return typed.strip() == model


def at_the_terminal(words: str) -> str:
    """Ask a person; return "" without a terminal."""
    try:
        return input(words)
    except EOFError:
        return ""


def main(words: Sequence[str] | None = None, ask: Callable[[str], str] = at_the_terminal) -> int:
    """Run the kit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("resources", nargs="*", help="VISA resource names; of a serial port with @ and its speed")
    parser.add_argument("--library", default="", help="the VISA library: @py, or a path; else PyVISA's own choice")
    parser.add_argument("--output", default="vcfbench-bundle.trace", help="the file that is written")
    given = parser.parse_args(words)
    try:
        import pyvisa  # noqa: PLC0415  # who asks for help need not have it
    except ImportError:
        print("PyVISA is not installed here: pip install pyvisa pyvisa-py")
        return 2

    def ended(*_: Any) -> None:
        raise KeyboardInterrupt

    with suppress(ValueError):  # not in a thread that is not the first
        signal.signal(signal.SIGTERM, ended)
    manager, code, bundle = pyvisa.ResourceManager(given.library), 0, None
    try:
        resources = given.resources or wanted(sorted(manager.list_resources("?*")), ask)
        with open(given.output, "x", encoding="ascii") as file:
            bundle = Bundle(file, versions(manager.visalib))
            for resource in resources:
                try:
                    talk_to(resource, manager, bundle, scripts(), ask)
                except Exception as error:  # a VISA library is anyone's code, and the others are still to be asked
                    print(f"{resource}: {error or type(error).__name__}")
                    code = 1
    except KeyboardInterrupt:
        print("\nstopped")
        code = 130
    except FileExistsError:
        print(f"{given.output} is there already: name another with --output")
        return 2
    if bundle is None or not bundle.names:
        if bundle is not None:
            Path(given.output).unlink()
        print("nothing answered: no file is written")
        return code or 1
    print(f"{given.output} is written. Look through it, then zip and send it: see the form 'Seen on' of our issues")
    return code


if __name__ == "__main__":
    sys.exit(main())
