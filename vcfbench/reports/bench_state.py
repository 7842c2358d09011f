"""The state of the bench, from the steps of a run: table, rails, V_Vc."""

from collections.abc import Callable
from typing import Any, Final, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps


class BenchState(Struct, frozen=True):
    """Last settings and read-backs of a bench; None before the first.

    `demand_deg_s` is the rate that the table was told, `table_deg_s` its read-back since, deg/s; `servo` whether its
    servo is closed. `supply` tells whether the outputs are on, `rails` are their read-backs. `v_vc` is the generator's
    setting in words, `generator` whether its output is on.
    """

    demand_deg_s: float | None = None
    table_deg_s: float | None = None
    servo: bool | None = None
    supply: bool | None = None
    rails: tuple[steps.RailReading, ...] = ()
    v_vc: str | None = None
    generator: bool | None = None

    def after(self, step: object, result: object) -> Self:
        """Return the state after `step` with its `result`; unknown steps change nothing."""
        stated: dict[str, Any] = {}
        for each in (step, result):
            kind = next((kind for kind in type(each).__mro__ if kind in _STATED), None)
            stated |= {} if kind is None else _STATED[kind](each)
        return replace(self, **stated)

    def begun(self, step: object) -> Self:
        """Return the state when `step` begins: a table that gets a rate is moving."""
        return (
            replace(self, demand_deg_s=step.rate_deg_s, table_deg_s=None) if isinstance(step, steps.SetRate) else self
        )

    def table(self) -> str:
        """Say in words the table's demand and its read-back."""
        if self.servo is False:
            return "table off"
        if self.demand_deg_s is None:
            return "table -"
        read = "" if self.table_deg_s is None else f", reads {self.table_deg_s:+.4f}"
        return f"table {self.demand_deg_s:+g}{read} deg/s"

    def supplied(self) -> str:
        """Return the read-backs of the rails in words; "" before the first."""
        if not self.rails:
            return "" if self.supply is None else "rails -" if self.supply else "rails off"
        return f"rails {' '.join(f'{rail.voltage_v:+.3f}' for rail in self.rails)} V"

    def driven(self) -> str:
        """Say in words the setting of V_Vc."""
        if self.generator is False:
            return "V_Vc off"
        return f"V_Vc {'-' if self.v_vc is None else self.v_vc}"


_STATED: Final[dict[type, Callable[[Any], dict[str, Any]]]] = {
    steps.EnableTable: lambda _: {"servo": True, "demand_deg_s": 0.0, "table_deg_s": None},
    steps.DisableTable: lambda _: {"servo": False, "demand_deg_s": None, "table_deg_s": None},
    steps.SetRate: lambda step: {"servo": True, "demand_deg_s": step.rate_deg_s, "table_deg_s": None},
    steps.EnableSupply: lambda _: {"supply": True},
    steps.DisableSupply: lambda _: {"supply": False, "rails": ()},
    steps.ConfigureGenerator: lambda _: {"generator": False},
    steps.EnableVvc: lambda _: {"generator": True},
    steps.DisableVvc: lambda _: {"generator": False},
    steps.SetSine: lambda step: {"v_vc": f"{step.amplitude_v:g} V, {step.frequency_hz:.6g} Hz"},
    steps.SetVibration: lambda _: {},  # which is added to V_Vc by a generator of its own
    steps.VvcSetting: lambda read: {"v_vc": f"{read.v_vc_v:+.5f} V"},
    steps.RateReading: lambda read: {"table_deg_s": read.rate_deg_s},
    steps.RailsReading: lambda read: {"rails": read.rails, "supply": True},
    steps.Window: lambda read: {
        **({} if read.table_rate_deg_s is None else {"table_deg_s": read.table_rate_deg_s}),
        **({"rails": read.rails} if read.rails else {}),
    },
}
"""What a step that is done, or its result, tells of the bench."""
