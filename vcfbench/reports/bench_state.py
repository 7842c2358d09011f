"""The state of the bench, as the steps of a run tell it: table, rails, V_Vc."""

from typing import Any, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps


class BenchState(Struct, frozen=True):
    """Last settings and read-backs of a bench; None where a run has not come to it.

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
        """Return the state when `step` is done, with `result`; steps that are not known change nothing."""
        read: dict[str, Any] = {}
        match result:
            case steps.RateReading():
                read = {"table_deg_s": result.rate_deg_s}
            case steps.RailsReading():
                read = {"rails": result.rails, "supply": True}
            case steps.Window():
                read = {} if result.table_rate_deg_s is None else {"table_deg_s": result.table_rate_deg_s}
                read |= {"rails": result.rails} if result.rails else {}
        return replace(self, **_set_by(step, result), **read)

    def begun(self, step: object) -> Self:
        """Return the state when `step` begins: a table that is told a rate is on its way."""
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
        """Say in words the read-backs of the rails."""
        if self.supply is False:
            return "rails off"
        return f"rails {' '.join(f'{rail.voltage_v:+.3f}' for rail in self.rails)} V" if self.rails else "rails -"

    def driven(self) -> str:
        """Say in words the setting of V_Vc."""
        if self.generator is False:
            return "V_Vc off"
        return f"V_Vc {'-' if self.v_vc is None else self.v_vc}"


def _set_by(step: object, result: object) -> dict[str, Any]:
    """Return the settings of table, supply and generator by a step."""
    found: dict[str, Any] = {}
    match step:
        case steps.EnableTable():
            found = {"servo": True, "demand_deg_s": 0.0, "table_deg_s": None}
        case steps.DisableTable():
            found = {"servo": False, "demand_deg_s": None, "table_deg_s": None}
        case steps.SetRate():
            found = {"servo": True, "demand_deg_s": step.rate_deg_s, "table_deg_s": None}
        case steps.EnableSupply():
            found = {"supply": True}
        case steps.DisableSupply():
            found = {"supply": False, "rails": ()}
        case steps.EnableVvc() | steps.DisableVvc():
            found = {"generator": isinstance(step, steps.EnableVvc)}
        case steps.SetSine() if not isinstance(
            step, steps.SetVibration
        ):  # which is added to V_Vc by a generator of its own
            found = {"v_vc": f"{step.amplitude_v:g} V, {step.frequency_hz:.6g} Hz"}
        case steps.ConfigureGenerator() | steps.SetVvc() if isinstance(result, steps.VvcSetting):
            off = {"generator": False} if isinstance(step, steps.ConfigureGenerator) else {}
            found = {"v_vc": f"{result.v_vc_v:+.5f} V", **off}
    return found
