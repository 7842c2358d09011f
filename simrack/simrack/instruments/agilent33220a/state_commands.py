"""*SAV, *RCL, *LRN, *TST and MEMory:STATe."""

from __future__ import annotations

from typing import Any

from simrack.instruments.agilent33220a.declarations import SWITCH_S, NameParameter, names_reply
from simrack.instruments.agilent33220a.learning import learnt
from simrack.scpi import Boolean, Command, Integer, Limits, ScpiError, attribute, boolean, quoted, signed_integer


class _Place(Integer, frozen=True, kw_only=True):
    """The number of a memory: one that is not there is refused, not clipped, so that no other is overwritten."""

    def _within(self, value: float, limits: Limits, model: Any) -> float:
        del model
        if not limits.minimum <= value <= limits.maximum:
            raise ScpiError(-222)
        return value


_STATES = _Place(limits=Limits(0, 4))

COMMANDS = (
    Command("*SAV", (_STATES,), do=lambda model, place: model.save(place)),
    Command("*RCL", (_STATES,), do=lambda model, place: model.recall(place), takes_s=SWITCH_S),
    Command("*LRN", query=learnt),
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=5.0),
    Command(
        "MEMory:STATe:NAME",
        (_STATES, NameParameter(required=False)),
        do=lambda model, place, name: model.state_names.update({place: name or f"STATE_{place}"}),
        query=lambda model, place: model.state_names[place],
        query_parameters=(_STATES,),
        reply=quoted,
        reads=True,
    ),
    Command("MEMory:STATe:DELete", (_STATES,), do=lambda model, place: model.forget(place)),
    Command(
        "MEMory:STATe:VALid",
        query=lambda model, place: model.has_stored(place),
        query_parameters=(_STATES,),
        reply=boolean,
        reads=True,
    ),
    Command("MEMory:STATe:CATalog", query=lambda model: names_reply(list(model.state_names.values())), reads=True),
    attribute("MEMory:STATe:RECall:AUTO", Boolean(), "panel.auto_recall", boolean),
    Command("MEMory:NSTates", query=lambda _: 5, reply=signed_integer, reads=True),
)
