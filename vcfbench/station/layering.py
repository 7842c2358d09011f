"""Settings from the places that give them: each place goes before the one above it, and is named in errors."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from msgspec import NODEFAULT, UNSET, Struct, structs, to_builtins

from vcfbench.files import dotted, unfit_numbers
from vcfbench.station.settings import ProcedureSettings
from vcfbench.strict import Keys, Naming, converted, refusal, unknown_key
from vcfbench.typed import unboxed

_OURS = f"{__name__.partition('.')[0]}."

S = TypeVar("S", bound=ProcedureSettings)


class Layer(Struct, frozen=True):
    """Settings that one place gives, nested as in a bench file, and the names of their keys in errors."""

    values: Mapping[str, Any]
    naming: Naming

    def has(self, keys: Keys) -> bool:
        """Return True if the value at `keys`, or one above it, is given here."""
        below: Any = self.values
        for key in keys:
            if not isinstance(below, Mapping):
                return True
            if key not in below:
                return False
            below = below[key]
        return True


def setting_keys(kind: type[ProcedureSettings]) -> tuple[str, ...]:
    """Return the keys that can be set."""
    return tuple(key for key in kind.__struct_encode_fields__ if key != "station")


def require_defaults(kind: type[ProcedureSettings], called: str) -> None:
    """Hold the defaults of somebody's own settings against their types; ConfigError: one is none of its own."""
    if kind.__module__.startswith(_OURS):  # tests hold them
        return
    for each in structs.fields(kind):

        def naming(keys: Keys, key: str = each.encode_name) -> str:
            return f"{called}default of {dotted((key, *keys))}"

        value = each.default if each.default_factory is NODEFAULT else each.default_factory()
        if value is not NODEFAULT and value is not UNSET:
            converted(to_builtins(value, enc_hook=unboxed), each.type, naming)


def shared_settings(table: Mapping[str, Any], source: str) -> ProcedureSettings:
    """Return the settings in `table`, the ``[procedure]`` of the bench file `source`, for every procedure."""
    return chosen_settings(ProcedureSettings, [shared_layer(ProcedureSettings, table, source)])


def shared_layer(kind: type[ProcedureSettings], table: Mapping[str, Any], source: str) -> Layer:
    """Return the keys of ``[procedure]`` for procedures with settings of `kind`."""
    known = setting_keys(kind)
    given = {key: value for key, value in table.items() if key in known}
    return Layer(given, lambda keys: f"{source}: {dotted(('procedure', *keys))}")


def chosen_settings(kind: type[S], layers: Sequence[Layer]) -> S:
    """Return the settings that `layers` come to, the last before the others."""
    known = setting_keys(kind)
    values: dict[str, Any] = {}
    for layer in layers:
        for key in layer.values:
            if key not in known:
                raise unknown_key(key, known, layer.naming((key,)))
        for keys, expected, came in unfit_numbers(dict(layer.values)):
            raise refusal(layer.naming(keys), expected, came)
        values = merged(values, layer.values)
    return converted(values, kind, lambda keys: named(layers, keys))


def named(layers: Sequence[Layer], keys: Keys) -> str:
    """Name `keys` by where their value was given; one that is a default could be set for all procedures."""
    return next((layer for layer in reversed(layers) if layer.has(keys)), layers[0]).naming(keys)


def keys_of(path: str) -> Keys:
    """Return the keys of a path in the form of invalid values: ``drive.phase_deg``, ``rates_deg_s[2]``."""
    parts = re.findall(r"[^.\[\]]+|\[\d+\]", path)
    return tuple(int(part[1:-1]) if part.startswith("[") else part for part in parts)


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables `base` with `changes` in them."""
    table = dict(base)
    for name, value in changes.items():
        below = table.get(name)
        table[name] = merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return table
