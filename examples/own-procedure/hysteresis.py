"""Hysteresis on the rate table: the output at each rate on the way up and on the way down, generator off."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Annotated

import vcfbench as vb
from msgspec import Meta

UP, DOWN = 1, 2


class HysteresisSettings(vb.ProcedureSettings, frozen=True):
    loops: Annotated[int, Meta(ge=1, le=100, description="times up and down")] = 1


@dataclass(frozen=True, slots=True)
class Hysteresis:
    rates_deg_s: tuple[float, ...]
    width_v: tuple[float, ...]


def plan(settings: HysteresisSettings) -> vb.Plan:
    yield from vb.powered(settings, up_and_down(settings))


def up_and_down(settings: HysteresisSettings) -> vb.Plan:
    rates, previous_deg_s = sorted(set(settings.rates_deg_s)), 0.0
    for way, sweep in settings.loops * [(UP, rates), (DOWN, rates[::-1])]:
        yield vb.Note("Up" if way == UP else "Down")
        for rate_deg_s in sweep:
            yield from vb.go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
            yield from vb.take(settings, way, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)
            previous_deg_s = rate_deg_s


def results(settings: HysteresisSettings, points: Sequence[vb.Point]) -> Hysteresis:
    def mean_v(way: int, rate_deg_s: float) -> float:
        return fmean(p.output_v for p in points if (p.step, p.rate_deg_s) == (way, rate_deg_s))

    rates = tuple(sorted(set(settings.rates_deg_s)))
    return Hysteresis(rates, tuple(mean_v(UP, rate) - mean_v(DOWN, rate) for rate in rates))


def report(_settings: HysteresisSettings, _points: Sequence[vb.Point], found: Hysteresis) -> vb.Report:
    rate, width = vb.Column("rate", "deg/s", "g"), vb.Column("up - down", "V", ".1e")
    series = vb.Series("up - down", found.rates_deg_s, found.width_v)
    figure = vb.Figure("Hysteresis", vb.Axis("rate", "deg/s"), vb.Axis("up - down", "V"), [series])
    return vb.Report([vb.Table([rate, width], list(zip(found.rates_deg_s, found.width_v, strict=True))), figure])


TITLE = "Measure the output at each rate on the way up and on the way down."
HYSTERESIS = vb.Procedure(
    name="hysteresis", title=TITLE, settings=HysteresisSettings, plan=plan, results=results, report=report
)
