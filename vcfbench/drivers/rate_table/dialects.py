"""The languages of rate tables by name: in Python, or told in TOML."""

from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.rate_table.line import Link
from vcfbench.models import find_language, profile_reader, resolve


def spoken(name: str, settings: TableSettings) -> tuple[TableDialect, Link]:
    """Return the dialect `name` for an axis, and the line that it is spoken on.

    Raises:
        ConfigError: there is none of that name, its profile is wrong, or something that it needs is not told.
    """
    row = find_language(name)
    if row is not None and row.dialect is not None:
        return resolve(row.dialect)(settings), Link(baud=row.baud_rate)
    of_profile: tuple[TableDialect, Link] = profile_reader().spoken(name, settings.axis)
    return of_profile
