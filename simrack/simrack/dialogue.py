"""Devices of pyvisa-sim's files as they are: dialogues, properties, channels, errors (its specification, 1.1).

Not taken: `bases`, which pyvisa-sim 0.7.1 itself refuses, and files that come with pyvisa-sim (`bundled`). A property
whose format does not fit its value, an exception there, is answered as a number.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from string import Formatter
from typing import Any, ClassVar

from pyvisa import rname

from simrack.rate_tables.line import LineDevice, SerialTiming
from simrack.world import World

_TIMING = SerialTiming(baud=9600.0, processing_s=0.0)
_LONGEST = 1 << 16
_NO_ANSWER, _REFUSED = "\0", "\0refused"
"""Stand for an answer that is none, of what is understood, and for a value that a channel does not take."""
_SERVED_AS = ("TCPIP SOCKET", "TCPIP INSTR", "ASRL INSTR")
_RANDOM = re.compile(r"RANDOM\((-?\d*\.?\d*), (-?\d*\.?\d*), (\d+)\)")
_KINDS: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "": (".*?", str),
    "s": (".*?", str),
    "d": ("[0-9]+?", int),
    **dict.fromkeys("fF", (r"[0-9]+\.?[0-9]+", float)),
    **dict.fromkeys("eEgG", (r"[0-9]+\.?[0-9]+(?:[eE][-+]?[0-9]+)?", float)),
}
"""What a field of a setter takes, by the letter of its format; an integer of one digit is no float there."""
_TYPES: Mapping[str, Callable[[Any], Any]] = {"int": int, "float": float, "str": str, "": lambda value: value}


def _checked(said: Mapping[str, Any], value: Any) -> Any:
    """Return a value of a property in its type; ValueError if it is not within the specification."""
    specs = said.get("specs") or {}
    kind = _TYPES[specs.get("type", "")]
    value, valid = kind(value), {kind(each) for each in specs.get("valid", ())}
    low, high = (kind(specs.get(name, value)) for name in ("min", "max"))
    if value < low or value > high or (valid and value not in valid):
        raise ValueError(f"{value} is not within the specification")
    return value


def _setter(text: str) -> tuple[re.Pattern[str], list[tuple[str, Callable[[str], Any]]]]:
    """Return the pattern of a setter, and name and type of each of its fields."""
    pattern, fields = "", []
    for literal, name, form, _ in Formatter().parse(text):
        pattern += re.escape(literal)
        if name is None:
            continue
        taken, convert = _KINDS[form[-1:] if form else ""]
        sign = "" if not form else "[-+]" if form.startswith("+") else "[-]?"
        pattern += f"({sign}{taken})"
        fields.append((name, convert))
    return re.compile(f"^{pattern}$"), fields


def _shown(form: str, value: Any) -> str:
    if found := _RANDOM.search(form):
        low, high, count = float(found[1]), float(found[2]), int(found[3])
        form = form.replace(found[0], "")
        return ", ".join(form.format(random.uniform(low, high)) for _ in range(count))  # noqa: S311  # no secrets
    for convert in (lambda known: known, int, float):
        try:
            return form.format(convert(value))
        except (LookupError, ValueError):
            continue
    return str(value) or form


class _Part:
    """Dialogues and properties of a device, or of its channels."""

    def __init__(self, said: Mapping[str, Any]) -> None:
        self._dialogues = {_text(each, "q"): _text(each, "r") for each in said.get("dialogues", ())}
        self._properties = said.get("properties", {})
        self._first = {name: _checked(each, each.get("default", "")) for name, each in self._properties.items()}
        self._values: dict[tuple[str, Any], Any] = {}
        self._setters = [
            (name, each["setter"], _setter(_text(each["setter"], "q")))
            for name, each in self._properties.items()
            if "setter" in each
        ]

    def value(self, name: str, channel: Any = None) -> Any:
        """Return the value of a property, of a channel."""
        return self._values.get((name, channel), self._first[name])

    def queried(self, query: str, channel: Any, named: Callable[[str], str]) -> str | None:
        """Return the reply of a dialogue or a getter; `named` puts the channel into the pattern."""
        for listened, answer in self._dialogues.items():
            if named(listened) == query:
                return _shown(answer, "") if "RANDOM" in answer else answer
        for name, each in self._properties.items():
            if "getter" in each and named(_text(each["getter"], "q")) == query:
                return _shown(_text(each["getter"], "r"), self.value(name, channel))
        return None

    def commanded(self, query: str, channel: Any, refused: str | None) -> str | None:
        """Return the reply of a setter; `refused` if a value is wrong and the setter has no word for that."""
        for name, setter, (pattern, fields) in self._setters:
            if (found := pattern.search(query)) is None:
                continue
            values = {field: convert(text) for (field, convert), text in zip(fields, found.groups(), strict=True)}
            channel = values.pop("ch_id", channel)
            try:
                self._values[name, channel] = _checked(self._properties[name], next(iter(values.values()), ""))
            except ValueError:
                wrong = _text(setter, "e") if "e" in setter else refused
                if wrong is not None:
                    return wrong
            else:
                return _text(setter, "r")
        return None


def _text(said: Mapping[str, str], name: str) -> str:
    if name not in said:
        return _NO_ANSWER
    return said[name].strip(" ").replace("\\r", "\r").replace("\\n", "\n")


class DialogueDevice(LineDevice):
    """A device of a file.

    Args:
        world: where bench time is from.
        said: its part of the file.
        interface: as in the file's `eom`: ``TCPIP SOCKET``.
        ids: numbers of its channels, where the resource says them.
    """

    by_visa: ClassVar[bool] = True

    def __init__(
        self, world: World, said: Mapping[str, Any], interface: str, ids: Mapping[str, list[str]] | None = None
    ) -> None:
        if "bases" in said:
            raise ValueError("bases: expected no such key; write the definition out in the file")
        ends = said.get("eom", {}).get(interface, {"q": "\n", "r": "\n"})
        super().__init__(world, _TIMING, terminators=_text(ends, "q").encode(), longest=_LONGEST)
        self._end, self._delimiter = _text(ends, "r"), said.get("delimiter", ";")
        self._own = _Part(said)
        self._channels = [
            (_Part(each), (ids or {}).get(name) or list(each.get("ids", ())), each.get("can_select") != "False")
            for name, each in said.get("channels", {}).items()
        ]
        error = said.get("error", {})
        error = {"response": {"command_error": error}} if isinstance(error, str) else error
        self._wrong: str = error.get("response", {}).get("command_error", _NO_ANSWER)
        self._registers = {
            each["q"]: [0, int(each.get("command_error", 0))] for each in error.get("status_register", ())
        }
        self._queues = {each["q"]: (each, list[str]()) for each in error.get("error_queue", ())}

    def _answer(self, message: bytes) -> None:
        text = message.decode()
        for query in text.split(self._delimiter) if self._delimiter else [text]:
            answer = self._said_to(query)
            if answer != _NO_ANSWER:
                self._send((answer + self._end).encode())

    def _said_to(self, query: str) -> str:
        answer = self._own.queried(query, None, lambda listened: listened)
        if answer is not None:
            return answer
        if query in self._registers:
            value, self._registers[query][0] = self._registers[query][0], 0
            return str(value)
        if query in self._queues:
            words, waiting = self._queues[query]
            return waiting.pop(0) if waiting else str(words["default"])
        answer = self._own.commanded(query, None, None)
        channels = (self._of_channel(query, *each) for each in self._channels if answer is None)
        answer = next((each for each in channels if each is not None), answer)
        return self._error() if answer in {None, _REFUSED} else str(answer)

    def _of_channel(self, query: str, part: _Part, ids: list[str], named_in_query: bool) -> str | None:  # noqa: FBT001
        if named_in_query:
            for channel in ids:
                if (answer := part.queried(query, channel, partial(str.format, ch_id=channel))) is not None:
                    return answer
            return part.commanded(query, ids[-1] if ids else None, _REFUSED)
        selected = self._own.value("selected_channel")
        if selected not in ids:
            return None
        answer = part.queried(query, selected, str)
        return part.commanded(query, selected, _REFUSED) if answer is None else answer

    def _error(self) -> str:
        for register in self._registers.values():
            register[0] |= register[1]
        for words, waiting in self._queues.values():
            if "command_error" in words:
                waiting.append(words["command_error"])
        return self._wrong


class DialogueFile:
    """A file of pyvisa-sim's.

    Raises:
        ValueError: it is none.
        OSError: it cannot be read, or PyYAML is not there.
    """

    def __init__(self, file: Path) -> None:
        try:
            yaml = import_module("yaml")
        except ImportError as error:
            raise OSError(f"{file}: to read it takes PyYAML (pip install pyyaml)") from error
        self._file = file
        self.said = yaml.load(file.read_text(encoding="utf-8"), Loader=yaml.loader.BaseLoader)
        if not isinstance(self.said, dict) or str(self.said.get("spec", "")).partition(".")[0] != "1":
            raise ValueError(f'{file}: expected a file of pyvisa-sim with spec: "1.1"')

    def by_device(self) -> dict[str, Callable[[World], DialogueDevice]]:
        """Return a factory of each of its devices, to be served, by name."""
        found: dict[str, Callable[[World], DialogueDevice]] = {}
        for name, said in self.said.get("devices", {}).items():
            kind = next((each for each in _SERVED_AS if each in said.get("eom", {})), _SERVED_AS[0])
            found[_name(name)] = partial(DialogueDevice, said=said, interface=kind)
        return found

    def by_resource(self, device: str) -> dict[str, Callable[[World], DialogueDevice]]:
        """Return a factory of a device for each resource that is the device of this name."""
        found: dict[str, Callable[[World], DialogueDevice]] = {}
        for name, where in self.said.get("resources", {}).items():
            if "bundled" in where or _name(where["device"]) != device:
                continue
            known = DialogueFile(self._file.parent / where["filename"]) if "filename" in where else self
            parsed, said = rname.ResourceName.from_string(name), known.said["devices"][where["device"]]
            kind = f"{parsed.interface_type} {parsed.resource_class}"
            found[str(parsed)] = partial(DialogueDevice, said=said, interface=kind, ids=where.get("channel_ids"))
        return found


def _name(device: str) -> str:
    return re.sub(r"[^\w-]+", "_", device)
