"""``--set KEY=VALUE`` into settings: values are TOML's, lists may do without brackets, texts without quotes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vcfbench.errors import ConfigError
from vcfbench.files import dotted, is_utf8, parse_toml
from vcfbench.station.layering import Layer

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Mapping


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
        ConfigError: a setting has no key or no value, a key is given twice, or what is given is no UTF-8.
    """
    values: dict[str, Any] = {key: _value(text) for key, text in options.items()}
    for each in given:
        if not is_utf8(each):
            raise ConfigError(f"--set {each!a}: expected UTF-8")
        key, equals, text = each.partition("=")
        if not equals or not all(part.strip() for part in key.split(".")):
            raise ConfigError(f"--set {each}: expected KEY=VALUE, as in --set samples=20")
        keys = [part.strip() for part in key.split(".")]
        _put(values, keys, _meant(dotted(keys), text.strip(), lists_of_texts, texts), each)

    def naming(keys: tuple[str | int, ...]) -> str:
        path = dotted(keys)
        return names[path] if path in options else f"--set {path}"

    return Layer(values, naming)


def _put(values: dict[str, Any], keys: list[str], value: object, said: str) -> None:
    *above, last = keys
    for key in above:
        values = values.setdefault(key, {})
        if not isinstance(values, dict):
            raise ConfigError(f"--set {said}: {key} is given twice, as a table and as a value")
    if last in values:
        raise ConfigError(f"--set {said}: {'.'.join(keys)} is given twice")
    values[last] = value


def _meant(key: str, text: str, lists_of_texts: Container[str], texts: Container[str]) -> object:
    """Return the value of `key` that `text` stands for."""
    if key in lists_of_texts:
        # The list of texts that `text` stands for: TOML, or texts without quotes between commas
        found = _value(text.strip())
        if not isinstance(found, str) or text.strip()[:1] in {"'", '"', "["}:
            return found
        return [each.strip() for each in found.split(",")]
    found = _value(text)
    return text if key in texts and not isinstance(found, str) else found


def _value(text: str) -> object:
    """Return the value that `text` stands for: TOML, a list without its brackets, or else a text as it stands."""
    for form in (text, f"[{text}]") if "," in text else (text,):
        try:
            table = parse_toml(f"value = {form}", "--set")
        except ConfigError:
            continue
        if set(table) == {"value"}:
            return table["value"]
    return text
