"""``--dut``, ``--operator``, ``--note``, ``--tag`` and the conditions of the room, as a run takes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

METADATA_OPTIONS = ("dut", "operator", "note", "tag", "ambient_temperature_c", "humidity_percent")
"""Names of the options of ``vcfbench run`` that only the record is told."""


def metadata_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that were given, by the names that a record has; ConfigError where one cannot be used."""
    given = {name: value for name, value in options.items() if value is not None and name not in _OWN_FORM}
    tags = tags_of(options["tag"] or ())
    return {**given, **_ambient(options["ambient_temperature_c"]), **({"tags": tags} if tags else {})}


_OWN_FORM = ("tag", "ambient_temperature_c")


def _ambient(text: str | None) -> dict[str, Any]:
    """Return the temperature of the room, or the role that shall tell it."""
    if text is None:
        return {}
    if text == "chamber":
        return {"ambient_from": text}
    try:
        return {"ambient_temperature_c": float(text)}
    except ValueError:
        raise ConfigError(f"--ambient-temperature-c {text}: expected degC, as in 23.1, or chamber") from None


def tags_of(given: Iterable[str]) -> dict[str, str]:
    """Return the values of each ``--tag``.

    Raises:
        ConfigError: one has no key or no value, or a key is given twice.
    """
    tags: dict[str, str] = {}
    for each in given:
        key, equals, value = (part.strip() for part in each.partition("="))
        if not (key and equals and value):
            raise ConfigError(f"--tag {each}: expected KEY=VALUE, as in --tag batch=7")
        if key in tags:
            raise ConfigError(f"--tag {each}: {key} is given twice")
        tags[key] = value
    return tags
