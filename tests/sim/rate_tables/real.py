"""The World's own table with an attended clock around it."""

from __future__ import annotations

from vcfbench.clock import VirtualClock
from vcfbench.sim.attendance import AttendedClock
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.motion import TableMotion


class RealWorld:
    """A clock and the table with its loop, mean-rate error and ripple."""

    def __init__(self) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.table = TableMotion(self.clock, paper_bench().table, lambda: None)
