"""The languages of rate tables by name: built in, shipped as a profile, or told by a TOML file of one's own."""

from msgspec import Struct

from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.rate_table.line import Link
from vcfbench.models import find_language, resolve


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
    from vcfbench.drivers.rate_table.configurable import ConfigurableDialect  # noqa: PLC0415 - few benches need it
    from vcfbench.drivers.rate_table.profile import load_profile  # noqa: PLC0415 - as above

    profile = load_profile(name)
    return Spoken(ConfigurableDialect(profile, wanted.axis), profile.link)
