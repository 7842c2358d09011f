"""The roles of a bench: the stage of making each safe, its duration, and its proof."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.errors import ConfigError, InterlockError
from vcfbench.safety.stack import SafeAction, Stage

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from vcfbench.interfaces import FunctionGenerator, Instrument, RateTable
    from vcfbench.station.description import BenchDescription

STILL_DEG_S = 0.05
"""A read-back below this is a table at rest: above the flutter of any read-back, below any rate worth the name."""


class Role(Struct, frozen=True):
    """A place on the bench: its name in the bench file, its stage of making safe, and the test that it is not safe."""

    name: str
    stage: Stage
    wrong: Callable[[Any], str | None]


def filled_roles(description: BenchDescription) -> list[Role]:
    """Return the roles that the bench fills, in the order of opening."""
    return [role for role in ROLES if getattr(description, role.name) is not None]


def driving_roles(description: BenchDescription) -> tuple[Role, ...]:
    """Return the roles that drive something, in the order of making safe."""
    driving = (role for role in filled_roles(description) if role.stage is not Stage.REST)
    return tuple(sorted(driving, key=lambda role: role.stage))


def needed_roles(description: BenchDescription, needs: Collection[str] | None) -> list[Role]:
    """Return the roles to be opened, in order, for instruments of `needs`; None stands for all.

    What drives something is opened whether it is needed or not: it may be on, and must be made safe.

    Raises:
        ConfigError: the bench has no instrument for a role of `needs`.
    """
    filled = filled_roles(description)
    if needs is None:
        return filled
    for name in needs:
        if name not in {role.name for role in filled}:
            raise absent(name, description)
    return [role for role in filled if role.stage is not Stage.REST or role.name in needs]


def absent(role: str, description: BenchDescription) -> ConfigError:
    """Return the error that says that the bench has no instrument for `role`, or that it was not opened."""
    if getattr(description, role, None) is None:
        what = f"bench {description.name} has none"
        return ConfigError(what, instrument=role, hint=f"its bench file needs a table [{role}]")
    return ConfigError(
        f"it was not opened, because the procedure does not name it: bench {description.name}",
        instrument=role,
        hint="name it in the `needs` of the procedure, or of open_bench",
    )


def safe_action(role: Role, instrument: Instrument, description: BenchDescription) -> SafeAction:
    """Return how `instrument` is made safe; a table is given time to come down from the highest rate, and to say so."""
    deadline_s = 4.0 * getattr(description, role.name).timeout_s
    if role.stage is Stage.MOTION:
        ramp_s = description.limits.of("max_rate_deg_s") / description.procedure.acceleration_deg_s2
        deadline_s += 2.0 * (ramp_s + getattr(instrument, "own_time_s", 0.0))  # drivers of others need not know theirs
    return SafeAction(role.stage, instrument, deadline_s, lambda: role.wrong(instrument))


def require_still(table: RateTable) -> None:
    """Raise InterlockError if the table turns before the first command."""
    if wrong := _turns(table):
        raise InterlockError(
            f"{wrong} before any command was sent",
            instrument=table.name,
            resource=table.resource,
            hint="vcfbench stops it; find the program or person that turned it",
        )


def _turns(table: RateTable) -> str | None:
    rate = table.rate_deg_s()
    return None if abs(rate) <= STILL_DEG_S else f"it turns at {rate:.3g} deg/s"


def _drives(generator: FunctionGenerator) -> str | None:
    return "its output is on" if generator.output_enabled() else None


ROLES = (
    Role("power", Stage.POWER, lambda supply: "its outputs are on" if supply.outputs_enabled() else None),
    Role("rate_source", Stage.STIMULUS, _drives),
    Role("vibration_source", Stage.STIMULUS, _drives),
    Role("multimeter", Stage.REST, lambda _: None),
    Role("v_vc_meter", Stage.REST, lambda _: None),
    Role("oscilloscope", Stage.REST, lambda _: None),
    Role("chamber", Stage.STIMULUS, lambda chamber: "its air flows" if chamber.flow_enabled() else None),
    Role("rate_table", Stage.MOTION, _turns),
)
"""All roles in the order of opening; the table comes last, so that nothing can move before all else is there."""
