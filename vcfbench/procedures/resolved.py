"""A bench with the settings of all procedures as they come to be, written as a bench file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import to_builtins

from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import layers_of, plain_settings
from vcfbench.station.layering import chosen_settings, merged, setting_keys
from vcfbench.station.settings import ProcedureSettings
from vcfbench.station.writing import table_text

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription


def resolved_text(description: BenchDescription) -> str:
    """Return the bench file of `description` with every key of ``[procedure]``, defaults included."""
    return table_text(as_resolved(description))


def as_resolved(description: BenchDescription) -> dict[str, Any]:
    """Return `description` as nested tables, ``[procedure]`` with every key as it comes to be.

    The table of each installed procedure also holds the shared keys for which it has a value of its own.
    """
    shared = setting_keys(ProcedureSettings)
    everywhere = plain_settings(description.procedure, shared)
    given = {key: value for key, value in description.procedure_table.items() if key not in shared}
    own = {}
    for each in PROCEDURES.loaded():
        chosen = chosen_settings(each.settings, layers_of(each, description, description.name)).made_plain()
        table = plain_settings(chosen, setting_keys(each.settings)).items()
        if of_its_own := {key: value for key, value in table if key not in everywhere or value != everywhere[key]}:
            own[each.name] = merged(of_its_own, given.get(each.name, {}))
    return {**to_builtins(description), "procedure": {**everywhere, **given, **own}}
