"""A barometer that only talks: a line of pressure and temperature each second, whoever listens."""

from __future__ import annotations

import math

from simrack.own import OwnBox


class Barometer(OwnBox):
    """Says what the weather does, which goes up and down within an hour."""

    every_s = 1.0

    def says(self) -> bytes:
        """Return the line of now."""
        pressure_hpa = 1013.25 + 2.0 * math.sin(2.0 * math.pi * self.clock.now() / 3600.0)
        return b"P=%.2f hPa T=%.1f C\r\n" % (pressure_hpa, self.world.ambient_c())
