"""What tells that instruments are simulated, whatever the bench file says, and that instruments cannot be."""

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from os import environ

from vcfbench.errors import BenchError, ConfigError
from vcfbench.interfaces import Identity
from vcfbench.safety.roles import filled_roles
from vcfbench.station.description import BenchDescription
from vcfbench.station.resources import resource_key

CONTROL_PORT = 20220
CONTROL_VARIABLE = "VCFBENCH_CONTROL_PORT"
_HERE = re.compile(r"(socket|lan) localhost\b|serial /dev/pts/")


def simulated_roles(description: BenchDescription, identities: Mapping[str, Identity]) -> tuple[str, ...]:
    """Return the roles of the opened instruments that are known to be simulated.

    A simulated instrument has a serial number that was made up. One alone is believed on this computer; elsewhere two,
    since a laboratory may own that one. Those on this computer are also in the list of the server at the usual port.
    """
    from simrack.serial_numbers import is_simulated_serial  # noqa: PLC0415  # benches with [simulation] load no more

    keys = {role: resource_key(description.owned(role)) for role in identities if description.owned(role)}
    here = {role for role, key in keys.items() if _HERE.match(key)}
    made_up = {role for role, each in identities.items() if is_simulated_serial(each.serial)}
    found = made_up if len(made_up) > 1 else made_up & here
    if here - found:
        served = _served_here()
        found |= {role for role in here if keys[role] in served}
    return tuple(sorted(found))


def _served_here() -> frozenset[str]:
    """Return the places of the bench that is served on this computer at the usual control port; none where none is."""
    from vcfbench.sim.served import served_wires  # noqa: PLC0415

    with suppress(BenchError):
        return frozenset(map(resource_key, served_wires(environ.get(CONTROL_VARIABLE, str(CONTROL_PORT)))))
    return frozenset()


def require_all_served(description: BenchDescription, roles: Collection[str] | None) -> None:
    """See that no instrument of a served bench is beyond this computer: it would know nothing of simulated time.

    ConfigError: one is.
    """
    for role in [each.name for each in filled_roles(description)] if roles is None else roles:
        resource = description.owned(role)
        if resource and role not in description.by_hand and not _HERE.match(resource_key(resource)):
            raise ConfigError(
                "expected a simulated instrument of this computer beside [served], whose time it has",
                instrument=role,
                resource=resource,
                hint="without the table [served] the bench is a real one",
            )
