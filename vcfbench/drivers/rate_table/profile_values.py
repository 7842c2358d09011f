"""Values of the fields and flags of a profile from a reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.drivers.rate_table.fields import decode, text_value, unwrapped
from vcfbench.errors import FramingError

if TYPE_CHECKING:
    from vcfbench.drivers.rate_table.profile import Field, Flag, Profile
    from vcfbench.drivers.rate_table.profile_replies import Received


class ProfileValues:
    """Reads replies of the language of `profile` about one axis."""

    def __init__(self, profile: Profile, axis: int) -> None:
        self._profile = profile
        self._axis = axis

    def number(self, spec: Field, received: Received) -> float:
        """Return the value of a field, in deg or deg/s of the table's own sign."""
        if self._profile.binary:
            raw = decode(spec.type, received.data, spec.at or 0, self._profile.received_frame.order)
        else:
            raw = text_value("hex" if spec.type == "hex" else "decimal", self._piece(spec, received))
        return unwrapped(raw * spec.scale + spec.offset, spec.wrap)

    def _piece(self, spec: Field | Flag, received: Received) -> str:
        """Return the piece of a line that a field or flag is about."""
        if spec.group is not None:
            name = spec.group.format(axis=self._axis)
            if name not in received.groups:
                raise FramingError(f"the reply {received.text[:60]!r} has no {name}")
            return received.groups[name]
        pieces = list(received.groups.values()) if received.groups else received.text.split(",")
        if spec.item is None or spec.item >= len(pieces):
            raise FramingError(f"the reply {received.text[:60]!r} has no item {spec.item}")
        return pieces[spec.item]

    def holds(self, spec: Flag, received: Received) -> bool:
        """Tell whether a flag is raised, before its `negate`."""
        if spec.contains is not None:
            text = received.data.decode("latin-1") if self._profile.binary else self._piece(spec, received)
            return spec.contains in text
        value = self._flag_value(spec, received)
        if spec.bit is not None:
            return bool(int(value) >> spec.bit & 1)
        if spec.mask is not None:
            return int(value) & spec.mask == (spec.mask if spec.value is None else spec.value)
        if spec.among is not None:
            return value in spec.among
        return (spec.above is None or value > spec.above) and (spec.below is None or value < spec.below)

    def _flag_value(self, spec: Flag, received: Received) -> float:
        if self._profile.binary:
            return decode(spec.type, received.data, spec.at or 0, self._profile.received_frame.order)
        return text_value("hex" if spec.type == "hex" else "decimal", self._piece(spec, received))
