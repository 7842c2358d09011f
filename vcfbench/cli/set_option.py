"""``--set KEY=VALUE`` into settings: values are TOML's, lists may do without brackets, texts without quotes.

In a list of numbers ``START:STOP:STEP`` is a range with both its ends, as in ``-200,-5:5:0.5,200``.
"""

import re
from collections.abc import Container, Iterable, Mapping
from decimal import Decimal
from typing import Any, Final

from vcfbench.errors import ConfigError
from vcfbench.files import dotted, is_utf8, parse_toml
from vcfbench.station.layering import Layer

_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})?"
_RANGE: Final = re.compile(rf"\s*({_NUMBER}):({_NUMBER}):({_NUMBER})\s*")
_RANGES: Final = re.compile(rf"(?:{_RANGE.pattern}|\s*{_NUMBER}\s*)(?:,(?:{_RANGE.pattern}|\s*{_NUMBER}\s*))*")
_MOST: Final = 10_000
"""Numbers of a range; no setting takes more."""


def asked_by_command(
    given: Iterable[str],
    options: Mapping[str, str],
    names: Mapping[str, str],
    lists_of_texts: Container[str] = (),
    texts: Container[str] = (),
) -> Layer:
    """Return the settings of a command line.

    Args:
        given: what stands behind each ``--set``.
        options: values of options that stand for a key each.
        names: what the option of such a key is called.
        lists_of_texts: keys whose value is a list of texts, which may do without brackets and quotes.
        texts: keys whose value is a text, which may do without quotes also where it reads as a number: 0042.

    Raises:
        ConfigError: a setting has no key or no value, a key is given twice, what is given is no UTF-8, or a range has
            no whole number of steps from its start to its stop.
    """
    values: dict[str, Any] = {key: plain_value(text, names[key]) for key, text in options.items()}
    for each in given:
        if not is_utf8(each):
            raise ConfigError(f"--set {each!a}: expected UTF-8")
        key, equals, text = each.partition("=")
        if not equals or not all(part.strip() for part in key.split(".")):
            raise ConfigError(f"--set {each}: expected KEY=VALUE, as in --set samples=20")
        keys = [part.strip() for part in key.split(".")]
        *above, last = keys
        table = values
        for part in above:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise ConfigError(f"--set {each}: {part} is given twice, as a table and as a value")
        if last in table:
            raise ConfigError(f"--set {each}: {'.'.join(keys)} is given twice")
        table[last] = _meant(dotted(keys), text.strip(), lists_of_texts, texts)

    def naming(keys: tuple[str | int, ...]) -> str:
        path = dotted(keys)
        return names[path] if path in options else f"--set {path}"

    return Layer(values, naming)


def _meant(key: str, text: str, lists_of_texts: Container[str], texts: Container[str]) -> object:
    """Return the value of `key` that `text` stands for."""
    found = plain_value(text, f"--set {key}")
    if key in lists_of_texts:  # in TOML, or texts without quotes between commas
        quoted = text[:1] in {"'", '"', "["}
        return found if quoted or not isinstance(found, str) else [each.strip() for each in found.split(",")]
    return text if key in texts and not isinstance(found, str) else found


def plain_value(text: str, option: str) -> object:
    """Return the value of `text`: TOML, a list without its brackets, or else the text itself."""
    if ":" in text and _RANGES.fullmatch(text):
        return [number for part in text.split(",") for number in _numbers(part, option)]
    for form in (text, f"[{text}]") if "," in text else (text,):
        try:
            table = parse_toml(f"value = {form}", "--set")
        except ConfigError:
            continue
        if set(table) == {"value"}:
            return table["value"]
    return text


def _numbers(part: str, option: str) -> list[float]:
    """Return the numbers that `part` of a list stands for, a number or a range; decimal, so that 0.1 is a tenth."""
    found = _RANGE.fullmatch(part)
    if found is None:
        return [float(part)]
    start, stop, step = map(Decimal, found.groups())
    steps = (stop - start) / step if step else Decimal(-1)
    if not 0 <= steps < _MOST or steps % 1:
        expected = f"START:STOP:STEP, whole steps from start to stop, at most {_MOST} numbers, as -5:5:0.5"
        raise ConfigError(f"{option}: expected {expected}, got {part.strip()}")
    return [float(start + step * place) for place in range(int(steps) + 1)]
