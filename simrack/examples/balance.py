"""A balance that answers lines: S weighs, T tares, anything else is refused, as balances with MT-SICS do."""

from __future__ import annotations

from simrack.own import OwnBox


class Balance(OwnBox):
    """Weighs what is on its pan, which settles within a second."""

    takes_s = 0.05
    load_g, tare_g, put_s = 120.0, 0.0, 0.0

    def answer(self, message: bytes) -> bytes:
        """Answer a line."""
        if message == b"T":
            self.tare_g = self.load_g
            return b"T S %10.2f g\r\n" % self.tare_g
        if message == b"S":
            settled = b"S" if self.clock.now() - self.put_s > 1.0 else b"D"
            return b"S %b %10.2f g\r\n" % (settled, self.load_g - self.tare_g)
        return b"ES\r\n"
