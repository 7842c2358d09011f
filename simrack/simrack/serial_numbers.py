"""Serial numbers of the simulated instruments: made up, so that nobody takes one for an instrument of a laboratory."""

import re
from typing import Final

SERIAL_NUMBERS: Final = (
    *("MY44021876", "MY49520121", "MY51360123", "MY52701054", "MY53801234", "MY54100123", "MY54500001"),
    *("MY55510123", "MY59002391"),
)
"""Those of the first of its kind on a bench; the next ones count on."""
_OF_ONE_BENCH: Final = 100
_COUNTED = re.compile(r"([A-Z]+)(\d+)")


def is_simulated_serial(serial_number: str) -> bool:
    """Return True for a serial number that simulated instruments alone have."""
    found = _COUNTED.fullmatch(serial_number.strip().upper())
    firsts = filter(None, map(_COUNTED.fullmatch, SERIAL_NUMBERS))
    return found is not None and any(
        found[1] == first[1] and len(found[2]) == len(first[2]) and 0 <= int(found[2]) - int(first[2]) < _OF_ONE_BENCH
        for first in firsts
    )
