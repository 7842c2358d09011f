"""Replies of a table whose language a profile describes: expected, late and refusing ones, and their fields."""

import re
from collections.abc import Mapping

from msgspec import Struct, field

from vcfbench.clock import Deadline
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError
from vcfbench_tables.language import Field, Flag, Profile, Refusals, Reply, Step
from vcfbench_tables.messages import decode, take_frame, take_text, text_value, unwrapped


class Received(Struct, frozen=True):
    """A reply: bytes, or the text of a line and the groups of the pattern that it matched."""

    data: bytes
    text: str = ""
    groups: Mapping[str, str] = field(default_factory=dict)


class ProfileReplies:
    """Takes the replies of the language of `profile` from a line, and reads the fields of one axis."""

    def __init__(self, profile: Profile, axis: int) -> None:
        self._profile = profile
        self._axis = axis

    def await_prompt(self, line: TableLine, step: Step, within: Deadline) -> None:
        """Take lines until the prompt comes that ends the reply to `step`; InstrumentError for a refusal before it."""
        try:
            while (text := self._text(line, within)) != self._profile.link.prompt:
                self._require_accepted(line, text)
        except DeadlineExceeded:
            if not step.optional_reply:  # else it may come later
                raise

    def _text(self, line: TableLine, deadline: Deadline) -> str:
        return take_text(self._profile.received_frame, self._profile.link.rx_end, line, deadline)

    def await_reply(
        self,
        line: TableLine,
        name: str,
        deadline: Deadline,
        *,
        among_others: bool = False,
        out_of_order: bool = False,
        sent: str = "",
    ) -> Received:
        """Return the reply `name`; others are dropped if they may come late, or if `among_others`.

        Refusals are too where the line is `out_of_order`: of a torn message, or of the line end that was sent after it.
        """
        dropped: bytes | str = ""
        while True:
            try:
                received = self._receive(line, name, deadline)
            except DeadlineExceeded as error:
                if dropped:
                    error.what += f" but {dropped[:60]!r}"
                raise
            except FramingError:
                if not (among_others or out_of_order):
                    raise
                continue
            if isinstance(received, Received):
                prompt = self._profile.link.prompt
                while prompt is not None and self._text(line, deadline) != prompt:
                    pass
                return received
            dropped = received
            if not out_of_order:
                self._require_droppable(line, received, among_others=among_others, sent=sent)

    def _receive(self, line: TableLine, name: str, deadline: Deadline) -> Received | bytes | str:
        """Return the next message: as a reply if it is `name`, else as it came."""
        message: bytes | str
        if self._profile.binary:
            message = take_frame(self._profile.received_frame, line, deadline)
        else:
            message = self._text(line, deadline)
        return _matched(self._profile.replies[name], message) or message

    def _require_accepted(self, line: TableLine, message: bytes | str) -> None:
        """Raise InstrumentError for a refusal."""
        refusals = self._profile.refusals
        defined = refusals.pattern is not None if isinstance(message, str) else bool(refusals.bytes)
        if defined and _matched(refusals, message) is not None:
            raise InstrumentError(f"refused ({_shown(message)})", words=_shown(message), **line.where)

    def _require_droppable(self, line: TableLine, message: bytes | str, *, among_others: bool, sent: str) -> None:
        self._require_accepted(line, message)
        link = self._profile.link
        echo = link.echo == "optional" and message == sent
        late = echo or message == link.prompt or any(_matched(reply, message) for reply in self._unasked())
        if not late and not among_others:
            raise FramingError(f"got {_shown(message)[:60]!r}, which is no answer to the question")

    def _unasked(self) -> list[Reply]:
        """Return the replies that may come at any time."""
        stream = self._profile.stream
        own = [] if stream is None else [self._profile.replies[stream.reply]]
        return [*own, *(reply for reply in self._profile.replies.values() if reply.late)]

    # What a reply says

    def number(self, spec: Field | Flag, received: Received) -> float:
        """Return the value of a field, in deg or deg/s of the table's own sign; of a flag the number that decides."""
        if self._profile.binary:
            raw = decode(spec.type, received.data, spec.at or 0, self._profile.received_frame.order)
        else:
            raw = text_value("hex" if spec.type == "hex" else "decimal", self._piece(spec, received))
        return raw if isinstance(spec, Flag) else unwrapped(raw * spec.scale + spec.offset, spec.wrap)

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
        """Return True if a flag is raised, before its `negate`."""
        if spec.contains is not None:
            text = received.data.decode("latin-1") if self._profile.binary else self._piece(spec, received)
            return spec.contains in text
        value = self.number(spec, received)
        if spec.bit is not None:
            return bool(int(value) >> spec.bit & 1)
        if spec.mask is not None:
            return int(value) & spec.mask == (spec.mask if spec.value is None else spec.value)
        if spec.among is not None:
            return value in spec.among
        return (spec.above is None or value > spec.above) and (spec.below is None or value < spec.below)


def _shown(message: bytes | str) -> str:
    return message if isinstance(message, str) else message.hex(" ")


def _matched(form: Reply | Refusals, message: bytes | str) -> Received | None:
    """Return a message of this form, taken apart; None for any other."""
    if isinstance(message, bytes):
        has_all = all(each.at < len(message) and message[each.at] == each.value for each in form.bytes)
        return Received(message) if has_all else None
    found = re.fullmatch(form.pattern or "", message)
    if found is None:
        return None
    groups = {key: value for key, value in found.groupdict().items() if value is not None}
    if isinstance(form, Reply) and form.split is not None:
        groups |= {f"item_{number}": piece for number, piece in enumerate(message.split(form.split))}
    return Received(b"", message, groups)
