"""Compares a bundle of the kit with the simulated instruments: per command the same, different, or unknown.

The messages of the bundle are said to a simulated instrument of the model. Of what only reads, form, words and error
are compared, for nobody knows how the real one was set; of a setting after ``*RST`` the value too.
"""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from msgspec import Struct
from msgspec.structs import replace
from simrack.models import MODELS as TWINS
from simrack.scpi import Command, CommandTable
from simrack.scpi.parameters import Integer, Number, Text

from vcfbench.clock import Deadline
from vcfbench.drivers.trace import TraceLine
from vcfbench.errors import ConfigError, DeadlineExceeded
from vcfbench.testing.kit.program import ERROR_QUESTION, masked, model_of
from vcfbench.testing.kit.write import TwinWire, scripts, twin
from vcfbench.testing.replay import read_trace

Status = Literal["same", "answer", "form", "error", "timing", "no answer", "unknown"]

_READ = re.compile(r"(?P<sign>[+-]?)(?P<whole>\d+)(?P<rest>\.\d*)?(?P<exponent>E[+-]?\d+)?", re.IGNORECASE)
_SAMPLES = (0.0, 1.0, 0.25, 12.5, 1e-6, 1e6, 123456.0, 9.9e37)
_FIELD = re.compile(r'"[^"]*"|[^,"]+')
_WORD = re.compile(r"[A-Za-z_]+\d*")
_EXPONENT = re.compile(r"E\d*")
_BLOTTED = re.compile(r"[^A-WYZa-z1-9]*X[^A-WYZa-z1-9]*")
"""What has nothing but X and 0 in it: the program has put them there."""
_DRIVEN = " driven"
_OF_THE_STATE = frozenset(range(-299, -199))
"""Execution errors: what is refused for how an instrument is set tells nothing of another that is set otherwise."""
_CLOSE = 1e-6


class Finding(Struct, frozen=True):
    """What came of a command: `expected` is what the simulated instrument says, `got` what the real one said."""

    command: str
    status: Status
    expected: str = ""
    got: str = ""

    def __str__(self) -> str:
        return f"{self.command}: {self.status}: expected {self.expected}, got {self.got}"


class Seen(Struct, frozen=True):
    """An instrument of a bundle: its identity without the serial number, and what came of each command."""

    maker: str
    model: str
    firmware: str
    findings: tuple[Finding, ...]
    driven: bool = False

    def count(self, *statuses: Status) -> int:
        """Return the number of commands with one of these."""
        return sum(each.status in statuses for each in self.findings)

    @property
    def differing(self) -> tuple[Finding, ...]:
        """The commands that differ."""
        return tuple(each for each in self.findings if each.status not in {"same", "unknown"})

    def __str__(self) -> str:
        compared = f"{self.count('same')} commands the same, {len(self.differing)} differ"
        how = "read and set" if self.driven else "read"
        return f"seen on a {self.model}, firmware {self.firmware} ({how}): {compared}, {self.count('unknown')} unknown"


class _Heard(Struct, frozen=True):
    """A message of a bundle with what was answered, None for nothing, and how long that took, s."""

    message: str
    answer: str | None
    took_s: float = 0.0


def checked(path: Path | str) -> list[Seen]:
    """Return what a bundle says of each of its instruments.

    Raises:
        ConfigError: it is no bundle, or there is no command in it.
    """
    by_role: dict[str, list[TraceLine]] = {}
    for line in read_trace(path):
        by_role.setdefault(line.role.removesuffix(_DRIVEN), []).append(line)
    seen = [_seen(lines) for lines in by_role.values()]
    if not any(each.findings for each in seen):
        raise ConfigError(f"{path}: 0 commands: nothing in it")
    return seen


def _seen(lines: Sequence[TraceLine]) -> Seen:
    heard = list(_heard([line for line in lines if not line.role.endswith(_DRIVEN)]))
    after = list(_heard([line for line in lines if line.role.endswith(_DRIVEN)]))
    identity = next((each.answer for each in heard if each.message == "*IDN?" and each.answer), "")
    maker, _, _, firmware = (*identity.strip().split(",", 3), "", "", "", "")[:4]
    model = model_of(identity)
    if model not in TWINS:
        asked = (each for each in heard if each.message != ERROR_QUESTION)
        return Seen(maker, model, firmware, tuple(_unknown(each) for each in asked), bool(after))
    compared = _Compared(model)
    found = [*compared.findings(heard, exact=False), *compared.findings(after, exact=True)]
    return Seen(maker, model, firmware, tuple(found), bool(after))


def _heard(lines: Sequence[TraceLine]) -> Iterator[_Heard]:
    said: TraceLine | None = None
    answer, last_s = b"", 0.0
    for line in (*lines, None):
        if line is None or line.mark == ">":
            if said is not None:
                text = answer.decode("latin-1") if answer else None
                yield _Heard(said.data.decode("latin-1").strip(), text, last_s - said.t_s)
            said, answer = line, b""
        elif line.mark.startswith("<"):
            answer, last_s = answer + line.data, line.t_s


class _Compared:
    """A simulated instrument that is asked what the real one was."""

    def __init__(self, model: str) -> None:
        self._script = scripts()[model]
        self._table: CommandTable = TWINS[model].load().table
        self._device, self._clock = twin(model)
        self._wire = TwinWire(self._device, self._clock)
        self._deadlines: dict[str, float] = {message: deadline_s for message, _, deadline_s in self._script["drives"]}

    def findings(self, heard: Sequence[_Heard], *, exact: bool) -> Iterator[Finding]:
        """Yield what came of each message; an error is that of the message before the question for it."""
        found: Finding | None = None
        for each in heard:
            expected = self._asked(each)
            if each.message != ERROR_QUESTION:
                if found is not None:
                    yield found
                question = "?" in each.message
                found = self._question(each, expected, exact=exact) if question else Finding(each.message, "same")
            elif found is not None:
                one, other = _error(expected), _error(each.answer)
                if not exact and found.status == "no answer" and {one, other} & _OF_THE_STATE:
                    found = replace(found, status="unknown")
                elif one != other and found.status in {"same", "no answer"}:
                    found = Finding(found.command, "error", str(expected).strip(), str(each.answer).strip())
                yield found
                found = None
        if found is not None:
            yield found

    def _asked(self, heard: _Heard) -> str | None:
        wait_s = self._script["timeout_s"] * 3.0
        self._wire.send(heard.message.encode("latin-1", "replace") + b"\n", Deadline.after(self._clock, wait_s))
        if "?" not in heard.message:
            return None
        came, end = b"", False
        try:
            while not end:
                part, end = self._wire.receive(Deadline.after(self._clock, wait_s))
                came += part
        except DeadlineExceeded:
            self._device.clear()
            return None
        return masked(heard.message, came.decode("latin-1"), self._script["words"])

    def _question(self, heard: _Heard, expected: str | None, *, exact: bool) -> Finding:
        row = self._table.asked(heard.message)
        came = heard.answer
        shown = tuple("nothing" if text is None else text.strip() for text in (expected, came))
        if row is None:
            return _unknown(heard)
        if came is None or expected is None:
            return Finding(heard.message, "same" if came == expected else "no answer", *shown)
        status = _compared(row, came, expected, frozenset(self._script["words"]), exact=exact)
        deadline_s = self._deadlines.get(heard.message, float(self._script["timeout_s"]))
        if status == "same" and heard.took_s > deadline_s:
            return Finding(heard.message, "timing", f"{deadline_s:.2f} s at most", f"{heard.took_s:.2f} s")
        return Finding(heard.message, status, *shown)


def _unknown(heard: _Heard) -> Finding:
    return Finding(heard.message, "unknown", "anything", (heard.answer or "nothing").strip())


def _error(entry: str | None) -> int | None:
    """Return the number of an entry of an error queue."""
    number = (entry or "").strip().partition(",")[0]
    return int(number) if _READ.fullmatch(number) and number.lstrip("+-").isdigit() else None


def _compared(row: Command, came: str, expected: str, words: frozenset[str], *, exact: bool) -> Status:
    reported = _fields(came)
    if came.endswith("\n") != expected.endswith("\n"):
        return "form"
    if row.pattern == "*IDN":
        return "same" if came.count(",") == expected.count(",") else "form"
    if not any(_fits(_forms(reported), form) for form in (_forms(_fields(expected)), *_number_forms(row))):
        return "form"
    if exact and row.do is not None and row.reads:
        return "same" if _alike(reported, _fields(expected)) else "answer"
    bare = [each for each in reported if each[:1] != '"']
    named = [each for each in _WORD.findall(" ".join(bare)) if each.strip("X0") and not _EXPONENT.fullmatch(each)]
    text = any(isinstance(each, Text) for each in row.parameters)  # anyone's: it is blotted out
    hidden = not text and not any(map(_BLOTTED.fullmatch, _fields(expected))) and any(map(_BLOTTED.fullmatch, bare))
    return "answer" if hidden or not all(each.upper().rstrip("0123456789") in words for each in named) else "same"


def _fields(text: str) -> list[str]:
    return [each.strip() for each in _FIELD.findall(text.strip()) if each.strip(", ")]


def _forms(fields: Sequence[str]) -> list[tuple[Any, ...]]:
    """Return the form of each field; of several in a row with the same form one, for lists are of any length."""
    forms: list[tuple[Any, ...]] = []
    for each in fields:
        found = _READ.fullmatch(each)
        if found is None:
            form: tuple[Any, ...] = ("string",) if each[:1] == '"' else ("word",)
        else:
            exponent, decimals = found["exponent"] or "", len(found["rest"] or "")
            kind = "NR3" if exponent else "NR2" if decimals else "NR1"
            exact = (decimals, len(exponent)) if exponent else None
            form = (kind, None if found["sign"] == "-" else found["sign"], exact)
        if not forms or not _fits(forms[-1:], [form]):
            forms.append(form)
    return forms


def _fits(one: Sequence[tuple[Any, ...]], other: Sequence[tuple[Any, ...]]) -> bool:
    """Return True if forms are the same; of a negative number nobody knows how a positive one is written."""
    return len(one) == len(other) and all(
        len(left) == len(right) and all(a == b or None in (a, b) for a, b in zip(left, right, strict=True))
        for left, right in zip(one, other, strict=True)
    )


def _number_forms(row: Command) -> list[list[tuple[Any, ...]]]:
    """Return the forms in which a row tells its numbers: any where it writes them as short as they are."""
    kind = row.parameters[0] if row.parameters else None
    forms: list[list[tuple[Any, ...]]] = []
    if isinstance(kind, Number) and not isinstance(kind, Integer):
        for value in _SAMPLES:
            with suppress(Exception):  # a row of another kind of value
                forms.append(_forms(_fields(str(row.reply(value)))))
    return [[(None, None, None)]] if any(form != forms[0] for form in forms) else forms[:1]


def _alike(one: Sequence[str], other: Sequence[str]) -> bool:
    """Return True if fields say the same, numbers within their last digits; what is blotted out says nothing."""
    if len(one) != len(other):
        return False
    for left, right in zip(one, other, strict=True):
        if _READ.fullmatch(left) and _READ.fullmatch(right):
            if not math.isclose(float(left), float(right), rel_tol=_CLOSE, abs_tol=1e-12):
                return False
        elif left.upper() != right.upper() and not _BLOTTED.fullmatch(left):
            return False
    return True
