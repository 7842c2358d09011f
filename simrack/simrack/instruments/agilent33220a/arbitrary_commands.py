"""DATA and FUNCtion:USER: the arbitrary waveforms."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

from simrack.instruments.agilent33220a.arbitrary import crest, mean
from simrack.instruments.agilent33220a.declarations import NameParameter, names_reply, nr3, setting
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.scpi import Choice, Command, Limits, Number, Parameter, Rows, ScpiError, signed_integer
from simrack.scpi.lexer import Token, TokenKind

ROWS = Rows()


class _DacPoints(Parameter, frozen=True, kw_only=True):
    """A block of 16-bit words or a number -8191...8191."""

    def parse(self, token: Token) -> bytes | float:
        if token.kind is TokenKind.BLOCK:
            return token.text.encode("latin-1")
        if token.kind is not TokenKind.NUMBER:
            raise self.refuse_kind(token)
        return token.number


@ROWS.do("DATA", (Choice(("VOLATILE",)), Number(limits=Limits(-1.0, 1.0))), repeat=True)
def _load_points(model: _Model, place: str, *points: float) -> None:
    del place
    model.load(list(points))


@ROWS.do("DATA:DAC", (Choice(("VOLATILE",)), _DacPoints()), repeat=True)
def _load_dac(model: _Model, place: str, first: bytes | float, *others: bytes | float) -> None:
    del place
    values = _dac_block(first, model.state.order) if isinstance(first, bytes) else _dac_list((first, *others))
    if any(not -8191 <= value <= 8191 for value in values):
        raise ScpiError(-222)
    model.load([value / 8191.0 for value in values])


def _dac_block(data: bytes, order: str) -> list[float]:
    if len(data) % 2:
        raise ScpiError(800, "Block length must be even")
    words = struct.unpack(f"{'>' if order == 'NORM' else '<'}{len(data) // 2}h", data)
    return [float(word) for word in words]


def _dac_list(values: tuple[bytes | float, ...]) -> list[float]:
    if any(isinstance(value, bytes) for value in values):
        raise ScpiError(-168)
    return [round(value) for value in values if not isinstance(value, bytes)]


def _attribute(name: str, of: Callable[[Sequence[float]], float], reply: Callable[[float], str] = nr3) -> Command:
    return Command(
        f"DATA:ATTRibute:{name}",
        query=lambda model, which: of(model.memory.points(which or model.state.user)),
        query_parameters=(NameParameter(required=False),),
        reply=reply,
        reads=True,
    )


@ROWS.do("DATA:DELete:ALL")
def _delete_all(model: _Model) -> None:
    for name in model.memory.kept_names():
        model.delete(name)


def _set_user(model: _Model, name: str) -> None:
    model.memory.points(name)
    model.state.user = name
    model.update()


COMMANDS = (
    *ROWS,
    setting("FORMat:BORDer", Choice(("NORMal", "SWAPped")), "state.order"),
    Command(
        "DATA:COPY",
        (NameParameter(), NameParameter(required=False)),
        do=lambda model, name, source: model.memory.keep(name, source or "VOLATILE"),
    ),
    Command("DATA:CATalog", query=lambda model: names_reply(model.memory.names()), reads=True),
    Command("DATA:NVOLatile:CATalog", query=lambda model: names_reply(model.memory.kept_names()), reads=True),
    Command(
        "DATA:NVOLatile:FREE", query=lambda model: 4 - len(model.memory.kept_names()), reply=signed_integer, reads=True
    ),
    Command("DATA:DELete[:NAME]", (NameParameter(),), do=lambda model, name: model.delete(name)),
    _attribute("AVERage", mean),
    _attribute("CFACtor", crest),
    _attribute("POINts", len, signed_integer),
    _attribute("PTPeak", lambda points: (max(points) - min(points)) / 2.0),
    Command(
        "[SOURce:]FUNCtion:USER", (NameParameter(),), do=_set_user, query=lambda model: model.state.user, reads=True
    ),
)
