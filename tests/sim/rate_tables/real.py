"""The World's own table with an attended clock around it."""

from __future__ import annotations

from simrack.attendance import AttendedClock
from simrack.motion import TableMotion

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench


class RealWorld:
    """A clock and the table with its loop, mean-rate error and ripple."""

    def __init__(self) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.table = TableMotion(self.clock, paper_bench().table, lambda: None)
