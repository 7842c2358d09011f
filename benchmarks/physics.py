"""What simulated time costs: a dwell of any length, the motion of the table."""

from __future__ import annotations

import warnings

from measure import Figure, report, seconds_of
from simrack.sources import Drive

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.world import World

DEMANDS_DEG_S = (200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.0, -1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0)


def world() -> World:
    """Return a powered gyroscope on a table under servo."""
    made = World(VirtualClock(), paper_bench(), seed=1)
    made.set_rail("positive", 10.0)
    made.set_rail("negative", -10.0)
    made.table.close_servo()
    made.clock.sleep_until(5.0)
    made.value_v("output")
    return made


def dwell(made: World, seconds: float) -> float:
    start_s = made.clock.now()
    window = made.window("output", start_s, start_s + seconds)
    made.clock.sleep_until(start_s + seconds)
    return window.mean_v()


def switching_dwell(made: World, seconds: float) -> float:
    made.drive("v_vc", Drive(dc_v=0.25))
    made.drive("v_vc", None)
    return dwell(made, seconds)


def motion(made: World) -> float:
    """Move the table for 125 s through sixteen ramps, read back at 10 Hz as a driver that waits for a rate does."""
    started_s = made.clock.now()
    for index, rate_deg_s in enumerate(DEMANDS_DEG_S):
        made.table.demand_rate(rate_deg_s, 100.0)
        for _ in range(78):
            made.clock.sleep_until(made.clock.now() + 0.1)
            made.table.rate_deg_s()
        made.clock.sleep_until(started_s + (index + 1) * 125.0 / 16.0)
    return made.clock.now() - started_s


def figures() -> list[Figure]:
    warnings.simplefilter("error")
    made = world()
    second = seconds_of(lambda: switching_dwell(made, 1.0), 25)
    hour = seconds_of(lambda: switching_dwell(made, 3600.0), 25)
    turned_s = motion(made)
    return [
        report(Figure("dwell of a second", 1e3 * second, "ms")),
        report(Figure("dwell of an hour", 1e3 * hour, "ms")),
        report(Figure("dwell of an hour against a second", hour / second, "ratio", bar=1.2, gross=3.0)),
        report(Figure("125 s of table motion", 1e3 * seconds_of(lambda: motion(made)), "ms", bar=10, gross=200)),
        report(Figure("error of 125 s of simulated time", abs(turned_s - 125.0), "s", bar=0, gross=1e-9)),
    ]


if __name__ == "__main__":
    figures()
