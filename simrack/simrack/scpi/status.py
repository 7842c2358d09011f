"""Status registers of IEEE 488.2 and SCPI: condition, event, enable, and their summaries in the status byte."""

from __future__ import annotations


class Register:
    """A condition/event/enable triple. A rising condition bit latches the event bit.

    Args:
        parent: the register whose condition bit shows this one's summary, None for none or the status byte.
        bit: that bit's number.
    """

    __slots__ = ("_bit", "_condition", "_enable", "_event", "_parent")

    def __init__(self, parent: Register | None = None, bit: int = 0) -> None:
        self._condition = 0
        self._event = 0
        self._enable = 0
        self._parent = parent
        self._bit = bit

    @property
    def condition(self) -> int:
        """The state now."""
        return self._condition

    @property
    def enable(self) -> int:
        """The mask of event bits that reach the summary."""
        return self._enable

    @enable.setter
    def enable(self, mask: int) -> None:
        self._enable = mask
        self._propagate()

    def set_condition(self, condition: int) -> None:
        """Take the state `condition`; bits that rose latch."""
        rose = condition & ~self._condition
        self._condition = condition
        if rose:
            self.latch(rose)

    def set_bits(self, mask: int, value: int) -> None:
        """Take `value` for the condition bits in `mask`, keep the others."""
        self.set_condition(self._condition & ~mask | value & mask)

    def latch(self, bits: int) -> None:
        """Set event bits without a lasting condition."""
        self._event |= bits
        self._propagate()

    def read_event(self) -> int:
        """Return the event register and clear it."""
        event = self._event
        self.clear()
        return event

    def clear(self) -> None:
        """Clear the event register; condition and enable stay."""
        self._event = 0
        self._propagate()

    @property
    def summary(self) -> bool:
        """True if an enabled event is latched."""
        return bool(self._event & self._enable)

    def _propagate(self) -> None:
        if self._parent is not None:
            mask = 1 << self._bit
            self._parent.set_bits(mask, mask if self.summary else 0)


class Status:
    """The standard event status register, service request enable, and the registers that feed the status byte.

    Args:
        summaries: register of each status byte bit it feeds, e.g. `{3: questionable}`.
    """

    __slots__ = ("_requested", "_seen", "ese", "esr", "others", "sre", "summaries")

    def __init__(self, summaries: dict[int, Register], others: tuple[Register, ...] = ()) -> None:
        self.summaries = summaries
        self.others = others
        self.esr = 128
        self.ese = 0
        self.sre = 0
        self._seen = 0
        self._requested = False

    def clear(self) -> None:
        """*CLS: clear every event register."""
        self.esr = 0
        for register in (*self.others, *self.summaries.values()):
            register.clear()

    def read_esr(self) -> int:
        """Return the standard event status register and clear it."""
        esr, self.esr = self.esr, 0
        return esr

    def byte(self, *, message_available: bool) -> int:
        """Return the status byte without bit 6."""
        byte = 16 if message_available else 0
        if self.esr & self.ese:
            byte |= 32
        for bit, register in self.summaries.items():
            if register.summary:
                byte |= 1 << bit
        return byte

    def master(self, byte: int) -> int:
        """Return `byte` with bit 6 as *STB? shows it (MSS)."""
        return byte | 64 if byte & self.sre & ~64 else byte

    def note(self, byte: int) -> bool:
        """Take the present `byte`: a new reason for service requests it. Return True if service is requested."""
        reasons = byte & self.sre & ~64
        if reasons & ~self._seen:
            self._requested = True
        elif not reasons:
            self._requested = False
        self._seen = reasons
        return self._requested

    def poll(self, byte: int) -> int:
        """Serial poll: `byte` with bit 6 as RQS, which this clears."""
        requested = self.note(byte)
        self._requested = False
        return byte | 64 if requested else byte
