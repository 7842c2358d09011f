"""Reading of table languages in TOML: every mistake is one line with file, key and expectation.

What a profile can say is in :mod:`vcfbench_tables.language`.
"""

import re
import warnings
from collections.abc import Iterator, Mapping
from functools import partial
from importlib import resources
from typing import Any

from vcfbench.drivers.serial_wire import Link
from vcfbench.files import Keys, dotted, parse_toml, read_text, shown
from vcfbench.models import find_language
from vcfbench.strict import converted, refusal, words
from vcfbench_tables import language, messages
from vcfbench_tables.configurable import ConfigurableDialect
from vcfbench_tables.language import COMMANDS, QUESTIONS, STREAM, Field, Flag, Profile, Step
from vcfbench_tables.messages import Frame, Value


def spoken(name: str, axis: int) -> tuple[ConfigurableDialect, Link]:
    """Return the dialect of a profile for one axis, and its line; errors as of :func:`load_profile`."""
    profile = load_profile(name)
    return ConfigurableDialect(profile, axis), profile.link


def load_profile(name: str) -> Profile:
    """Return the shipped profile `name`, or that of the file of this name.

    Raises:
        ConfigError: there is none, or it is not one; the message is one line with file, key and what was expected.
    """
    return parse_profile(profile_text(name), f"profile {name}" if find_language(name) else shown(name))


def profile_text(name: str) -> str:
    """Return the text of the shipped profile `name`, or of the file of this name; ConfigError if it cannot be read."""
    row = find_language(name)
    if row is not None and row.dialect is None:
        return resources.files("vcfbench_tables").joinpath(f"profiles/{name}.toml").read_text("utf-8")
    return read_text(name, "a profile of a rate table")


def parse_profile(text: str, source: str) -> Profile:
    """Return the profile of the TOML `text`; `source` names it in errors (ConfigError)."""
    raw = parse_toml(text, source)
    # Try the entries under names of the profile's choice one by one: msgspec's path would not tell the name
    for section, kind in _KEYED.items():
        if isinstance(raw.get(section), dict):
            for name, value in raw[section].items():
                converted(value, kind, partial(_named, source, (section, name)))
    profile = converted(raw, Profile, partial(_named, source, ()))
    for found, path, expected, came in mistakes(profile):
        if found:
            raise refusal(f"{source}: {path}", expected, words(came))
    return profile


def _named(source: str, above: Keys, keys: Keys) -> str:
    return f"{source}: {dotted((*above, *keys))}"


_KEYED: dict[str, Any] = {
    "commands": tuple[Step, ...],
    "replies": language.Reply,
    "fields": Field,
    "status": Flag,
    "requires": language.Requirement,
}


# --- what the types cannot say ---

Row = tuple[object, str, str, object]
"""Whether it is a mistake, the key, what was expected there, what came."""

_SAMPLES: Mapping[str, Value] = {**dict.fromkeys(messages.NAMES, 1), "dir": "1"}
"""A value for each name, to try templates with."""
_ALWAYS_KNOWN = {name: value for name, value in _SAMPLES.items() if name in ("axis", "seq") or name.startswith("on_")}
"""Those that a template of stopping a table may use."""


def mistakes(profile: Profile) -> Iterator[Row]:
    """Yield every check of `profile`, in order; those after a mistake may not be asked for."""
    # Texts that no line can carry: else they would be found when the table is to be stopped
    texts = {
        "frame.start": profile.frame.start,
        "frame.checksum_mark": profile.frame.checksum_mark,
        "link.tx_end": profile.link.tx_end,
        "link.rx_end": profile.link.rx_end,
        "link.prompt": profile.link.prompt or "",
        "refusals.query": profile.refusals.query or "",
    }
    for path, text in texts.items():
        yield not text.isascii(), path, "ASCII characters alone", text
    yield from _frames("frame", profile.frame)
    if profile.reply_frame is not None:
        yield from _frames("reply_frame", profile.reply_frame)
        expected, kind = "line where messages are lines, and not where they are bytes", profile.reply_frame.kind
        yield (kind == "line") is profile.binary, "reply_frame.kind", expected, kind
    yield from _replies(profile)
    for name, steps in profile.commands.items():
        yield name not in COMMANDS, f"commands.{name}", f"one of {', '.join(COMMANDS)}", name
        for number, step in enumerate(steps):
            yield from _step(f"commands.{name}[{number}]", name, step, profile)
    for name in ("stop", "start"):
        yield not profile.commands.get(name), f"commands.{name}", "at least one step", None
    asked = [*filter(profile.commands.get, ("identify", "read_all", "read_pos")), *filter(None, [profile.stream])]
    yield not asked, "commands.identify", "a question that the table answers (its status will do), or [stream]", None
    known = {name for name, steps in profile.commands.items() if steps and name in QUESTIONS}
    yield from _fields(profile, known | ({STREAM} if profile.stream is not None else set()))
    yield from _circles(profile)
    yield from _safety(profile)


def _frames(path: str, frame: Frame) -> Iterator[Row]:
    yield frame.kind != "line" and not frame.header, f"{path}.header", "hexadecimal bytes", frame.header
    no_length = frame.kind == "fixed" and frame.length is None
    yield no_length, f"{path}.length", "the length of a frame", None
    no_place = frame.kind == "length_field" and frame.length_at is None
    yield no_place, f"{path}.length_at", "the place of the length", None
    yield frame.kind == "delimited" and not frame.trailer, f"{path}.trailer", "hexadecimal bytes", frame.trailer
    of_bytes = frame.kind == "line" and not (frame.checksum or "_hex").endswith("_hex")
    names = ", ".join(name for name in messages.CHECKSUMS if name.endswith("_hex"))
    yield of_bytes, f"{path}.checksum", f"for lines one of {names}", frame.checksum


def _replies(profile: Profile) -> Iterator[Row]:
    patterns = {f"replies.{name}.pattern": reply.pattern for name, reply in profile.replies.items()}
    patterns |= {"refusals.pattern": profile.refusals.pattern, "refusals.good": profile.refusals.good}
    for path, pattern in patterns.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", FutureWarning)  # what may mean something else to a later Python
                re.compile(pattern or "")
        except (re.error, FutureWarning, OverflowError, RecursionError) as error:
            yield True, path, f"a regular expression ({error})", pattern
    for name, reply in profile.replies.items():
        wrong = (reply.pattern is None) is not profile.binary or (bool(reply.bytes) and not profile.binary)
        expected = "bytes where messages are bytes, a pattern where they are lines"
        yield wrong, f"replies.{name}", expected, reply.pattern
    if profile.stream is not None:
        reply_name = profile.stream.reply
        yield reply_name not in profile.replies, "stream.reply", "one of [replies]", reply_name


def _step(path: str, name: str, step: Step, profile: Profile) -> Iterator[Row]:
    questions = f"0: only questions are asked again ({', '.join(QUESTIONS)})"
    yield step.retry and name not in QUESTIONS, f"{path}.retry", questions, step.retry
    repeated = step.repeat > 1 and name not in ("stop", "estop", *QUESTIONS)
    yield repeated, f"{path}.repeat", "1: only stopping is repeated blindly", step.repeat
    yield not {step.expect} <= {None, *profile.replies}, f"{path}.expect", "one of [replies]", step.expect
    both = step.expect is not None and step.no_reply
    yield both, f"{path}.no_reply", "false where a reply is expected", step.no_reply
    yield not {step.until} <= {None, *profile.status}, f"{path}.until", "one of [status]", step.until
    wrong = _untold(step.send or "", profile, _SAMPLES)
    yield wrong, f"{path}.send", f"a template ({wrong})", step.send


def _untold(template: str, profile: Profile, values: Mapping[str, Value]) -> ValueError | None:
    """Return the reason that a template cannot be filled with `values`; None if it can."""
    try:
        profile.message(template, values)
    except ValueError as error:
        return error
    return None


def _fields(profile: Profile, known: set[str]) -> Iterator[Row]:
    """Yield the checks of fields, flags and requirements; `known` are the sources that can be read."""
    sources = f"one of {', '.join(sorted(known))}"
    yield "position" not in profile.fields, "fields.position", "a field", None
    for name, each in profile.fields.items():
        path = f"fields.{name}"
        if each.differentiate is not None:
            other = profile.fields.get(each.differentiate)
            slope = other is None or other.differentiate is not None
            yield slope, f"{path}.differentiate", "a field that is read", each.differentiate
        else:
            yield each.source not in known, f"{path}.from", sources, each.source
            yield from _places(path, each, profile)
    rate, position = profile.fields.get("rate"), profile.fields.get("position")
    if rate is not None and rate.differentiate is None:
        came = f"{rate.source}, {rate.group or rate.item or rate.at}"
        yield rate == position, "fields.rate", "another number than the position", came
    for name, flag in profile.status.items():
        path = f"status.{name}"
        yield flag.source not in known, f"{path}.from", sources, flag.source
        kinds = (flag.bit, flag.mask, flag.among, flag.contains, flag.above, flag.below)
        yield (not any(kind is not None for kind in kinds), path, "one of bit, mask, in, contains, above, below", None)
        value, mask = flag.value or 0, flag.mask or 0
        yield value & ~mask, f"{path}.value", f"bits of mask, {mask:#x}", f"{value:#x}"
        yield from _places(path, flag, profile)
    for name, need in profile.requires.items():
        yield name not in profile.commands, f"requires.{name}", "one of [commands]", name
        yield need.flag not in profile.status, f"requires.{name}.flag", "one of [status]", need.flag
        yield not {need.by} <= {None, *profile.commands}, f"requires.{name}.by", "one of [commands]", need.by


def _places(path: str, each: Field | Flag, profile: Profile) -> Iterator[Row]:
    of_text = each.type in ("decimal", "hex")
    yield profile.binary and each.at is None, f"{path}.at", "the place of the first byte", None
    yield profile.binary and of_text, f"{path}.type", "a type of bytes", each.type
    nowhere = not profile.binary and each.group is None and each.item is None
    yield nowhere, f"{path}.group", "a named group of the reply's pattern, or an item", None
    if not profile.binary and each.group is not None:
        # Replies that its source brings, and their groups, of some axis
        brought = {step.expect for step in profile.commands.get(each.source or "", ())}
        if each.source == STREAM and profile.stream is not None:
            brought = {profile.stream.reply}
        group = r"\(\?P<" + re.escape(each.group).replace(r"\{axis\}", r"\w+") + ">"
        patterns = [reply.pattern or "" for name, reply in profile.replies.items() if name in brought]
        missing = not any(re.search(group, pattern) for pattern in patterns)
        yield missing, f"{path}.group", "a named group of the reply's pattern", each.group
    of_bytes = not profile.binary and isinstance(each, Field) and not of_text
    yield of_bytes, f"{path}.type", "decimal or hex", each.type


def _circles(profile: Profile) -> Iterator[Row]:
    """Find commands that need themselves, straight or by way of others: such a table would be asked for ever."""
    done: set[str] = set()

    def walk(name: str, way: tuple[str, ...]) -> Iterator[Row]:
        for path, came, needed in _needs(name, profile):
            if needed in way:
                circle = " -> ".join((*way, needed)[way.index(needed) :])
                yield True, path, f"what does not need {name} itself ({circle})", came
            elif needed not in done:
                yield from walk(needed, (*way, needed))
        done.add(name)

    for name in profile.commands:
        if name not in done:
            yield from walk(name, (name,))


def _needs(name: str, profile: Profile) -> Iterator[tuple[str, str, str]]:
    """Yield the commands that are sent for a command: the key that asks for it, its value, the command."""
    need, steps = profile.requires.get(name), enumerate(profile.commands[name])
    flags = [(f"commands.{name}[{number}].until", step.until) for number, step in steps]
    flags += [] if need is None else [(f"requires.{name}.flag", need.flag)]
    for path, flag in flags:
        if flag is not None and flag in profile.status and profile.status[flag].source in profile.commands:
            yield path, flag, profile.status[flag].source
    if need is not None and need.by in profile.commands:
        yield f"requires.{name}.by", str(need.by), str(need.by)


def _safety(profile: Profile) -> Iterator[Row]:
    for name in profile.safety.stop:
        yield name not in profile.commands, "safety.stop", "names of [commands]", name
    # See that the table can be told to stop whatever is known of it: these words are sent before all else
    words = [
        step.send for name in profile.safety.stop for step in profile.commands.get(name, ()) if step.send is not None
    ]
    yield not words, "safety.stop", "commands that send something", list(profile.safety.stop)
    for send in words:
        wrong = _untold(send, profile, _ALWAYS_KNOWN)
        yield wrong, "safety.stop", f"commands that need no rate, acceleration or position ({wrong})", send
    units = profile.units
    highest = f"at most rate_max, {units.rate_max:g}"
    yield units.rate_quantum > units.rate_max, "units.rate_quantum", highest, units.rate_quantum
    yield units.rate_min > units.rate_max, "units.rate_min", highest, units.rate_min
    expected = f"at most acceleration_max, {units.acceleration_max:g}"
    least = units.acceleration_min
    yield least > units.acceleration_max, "units.acceleration_min", expected, least
