"""The languages of rate tables by name: in Python, or told in TOML."""

from msgspec import Struct

from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.rate_table.line import Link
from vcfbench.models import find_language, profile_reader, resolve


class Spoken(Struct, frozen=True):
    """A dialect for one axis, and the line that it is spoken on."""

    dialect: TableDialect
    link: Link


def spoken(name: str, settings: TableSettings | None = None) -> Spoken:
    """Return the dialect `name` for an axis.

    Raises:
        ConfigError: there is none of that name, its profile is wrong, or something that it needs is not told.
    """
    wanted = settings or TableSettings()
    row = find_language(name)
    if row is not None and row.dialect is not None:
        return Spoken(resolve(row.dialect).for_axis(wanted), Link(baud=row.baud_rate))
    dialect, link = profile_reader().spoken(name, wanted.axis)
    return Spoken(dialect, link)
