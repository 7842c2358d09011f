"""Declarations of the 33220A's commands: settings, modes, angles, names."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from typing import Any

from simrack import scpi
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.scpi.lexer import Token, TokenKind

nr3 = scpi.real(13)


class NameParameter(scpi.Parameter, frozen=True, kw_only=True):
    """A free name without quotes: a letter, then letters, digits or underscores, at most 12 (unverified)."""

    def parse(self, token: Token) -> str:
        """Return the name; -144 for one too long."""
        if token.kind is not TokenKind.WORD:
            raise self.refuse_kind(token)
        if len(token.text) > 12:
            raise scpi.ScpiError(-144)
        return token.text


setting = partial(scpi.attribute, then=methodcaller("settle"))
"""A setting after which the others are made to fit it."""


def mode_switch(pattern: str, mode: str) -> scpi.Command:
    """Declare the switch of one of the modes, of which only one can be on."""
    return scpi.Command(
        pattern,
        (scpi.Boolean(),),
        do=lambda model, state: model.switch_mode(mode, on=state),
        query=lambda model: model.state.mode == mode,
        reply=scpi.boolean,
        reads=True,
    )


def frequency_limits(model: _Model) -> scpi.Limits:
    """Return the frequency limits of the function, Hz."""
    return scpi.Limits(*model.kind.frequency_hz[model.state.function], default=1000.0)


def _angle_limits(reach_deg: float, low_deg: float) -> Callable[[_Model], scpi.Limits]:
    def limits(model: _Model) -> scpi.Limits:
        factor = math.pi / 180.0 if model.state.angle == "RAD" else 1.0
        return scpi.Limits(low_deg * factor, reach_deg * factor)

    return limits


def angle(pattern: str, path: str, low_deg: float, high_deg: float) -> scpi.Command:
    """Declare an angle: kept in degrees, said in UNIT:ANGLe."""
    name = path.removeprefix("state.")

    def write(model: _Model, value: float) -> None:
        setattr(model.state, name, math.degrees(value) if model.state.angle == "RAD" else value)
        model.update()

    def read(model: _Model) -> float:
        degrees: float = getattr(model.state, name)
        return math.radians(degrees) if model.state.angle == "RAD" else degrees

    return scpi.Command(
        pattern, (scpi.Number(limits=_angle_limits(high_deg, low_deg)),), do=write, query=read, reply=nr3, reads=True
    )


def part_of_period(
    pattern: str, name: str, limits_s: Callable[[Any, Any], tuple[float, float]], words: str = ""
) -> scpi.Command:
    """Declare a time of the settings that is said in percent of the period; `limits_s` ask settings and kind."""

    def limits(model: _Model) -> scpi.Limits:
        return scpi.Limits(*(100.0 * each * model.state.frequency_hz for each in limits_s(model.state, model.kind)))

    def write(model: _Model, percent: float) -> None:
        setattr(model.state, name, percent / 100.0 / model.state.frequency_hz)
        model.settle()

    return scpi.Command(
        pattern,
        (scpi.Number(unit="PCT", limits=limits, name=words),),
        do=write,
        query=lambda model: 100.0 * getattr(model.state, name) * model.state.frequency_hz,
        reply=nr3,
        reads=True,
    )


def names_reply(names: list[str]) -> str:
    """Return names in quotes, with commas between them; of none an empty string."""
    return ",".join(map(scpi.quoted, names)) or '""'


SLOPES = scpi.Choice(("POSitive", "NEGative"))
POLARITIES = scpi.Choice(("NORMal", "INVerted"))
FIRST_HZ = 1e-6
SWITCH_S = 0.1
LEVEL_S = 0.03
TUNE_S = 0.002
"""Times of a change of function, level (attenuator relays) and frequency (unverified)."""
