"""A disk that loses all that was not synchronised: every state in which a power cut may leave the files of a folder.

::

    with Disk(folder) as disk:
        DeviceStore(folder).add(certificate)
        for state in disk.after_power_cut():
            state.lay(elsewhere)  # and see what a reader makes of it

It stands below Python's own file functions and lets them do what they do. Of what was written to a file since it was
synchronised a power cut keeps any beginning, the last piece torn or as zeros, or all but one piece; of the names in a
directory (made, given, taken away) any selection. What was synchronised stays. That is what POSIX promises, and less
than what most file systems do.
"""

import io
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, combinations, product
from pathlib import Path
from random import Random
from typing import Any, ClassVar, Self

from msgspec import Struct

Before = Callable[[int, str], float | None]
"""Called with the number of an operation, from 1, and its name, before it is done: returns the part of a write that
the disk takes (None: all), or raises an OSError, as a disk that is full or broken does."""

_MOST = 4
"""Names of a directory of which every selection is tried; of more, their beginnings and all but one."""
_DIRECTORY = 0
_OF_TWO = frozenset({"rename", "replace", "link"})
"""Operations on two paths."""


class _Change(Struct, frozen=True):
    """Bytes written to a file from `offset` on; None: cut there."""

    offset: int
    data: bytes | None


class _File(Struct):
    """A file's bytes on the disk, and the writes on their way there."""

    kept: bytes = b""
    pending: tuple[_Change, ...] = ()

    def images(self) -> Iterator[bytes]:
        """Yield the bytes that a power cut may leave of it, the whole first."""
        pending = self.pending
        yield _changed(self.kept, pending)
        for number, each in enumerate(pending):
            before, after = pending[:number], pending[number + 1 :]
            yield _changed(self.kept, before)
            if each.data:
                for torn in (each.data[: len(each.data) // 2], bytes(len(each.data))):
                    yield _changed(self.kept, [*before, _Change(each.offset, torn)])
            if after:
                yield _changed(self.kept, [*before, *after])


def _changed(data: bytes, changes: Sequence[_Change]) -> bytes:
    image = bytearray(data)
    for change in changes:
        image += bytes(max(0, change.offset - len(image)))
        new = change.data
        image[change.offset : None if new is None else change.offset + len(new)] = new or b""
    return bytes(image)


class DiskState(Struct, frozen=True):
    """Files with their bytes, by their path in the folder; directories have None."""

    files: Mapping[str, bytes | None]

    def lay(self, folder: Path) -> None:
        """Put it into an empty folder."""
        for name, data in sorted(self.files.items()):
            if data is None:
                (folder / name).mkdir()
            else:
                (folder / name).write_bytes(data)


class Disk:
    """The disk below `folder`, from when it is entered, all that lies there synchronised, until it is left.

    What is done once it is `stopped` changes nothing of what :meth:`now` and :meth:`after_power_cut` tell.
    """

    def __init__(self, folder: Path, before: Before | None = None) -> None:
        self.folder = Path(os.path.abspath(folder))  # noqa: PTH100  # links are left as they are
        self.operations = 0
        self.stopped = False
        self._before = before or (lambda _number, _what: None)
        self._files: dict[int, _File] = {_DIRECTORY: _File()}
        self._numbers: dict[str, int] = {}
        self._named: dict[str, int] = {}
        self._naming: dict[str, list[dict[str, int | None]]] = {}
        self._open: dict[int, tuple[str, int]] = {}
        self._plain: dict[str, Any] = {}

    def __enter__(self) -> Self:
        for path in sorted(self.folder.rglob("*")):
            name = str(path.relative_to(self.folder))
            self._numbers[name] = _DIRECTORY if path.is_dir() else self._fresh(path.read_bytes())
        self._named = dict(self._numbers)
        numbers = self._numbers
        ours: dict[str, Callable[..., Any]] = {
            "open": self._opened,
            "close": self._closed,
            "write": self._written,
            "ftruncate": self._truncated,
            "fsync": partial(self._synchronised, "fsync"),
            "fdatasync": partial(self._synchronised, "fdatasync"),
            "rename": partial(self._renamed, "rename", lambda name, to: {to: numbers[name], name: None}),
            "replace": partial(self._renamed, "replace", lambda name, to: {to: numbers[name], name: None}),
            "link": partial(self._renamed, "link", lambda name, to: {to: numbers[name]}),
            "unlink": partial(self._renamed, "unlink", lambda name: {name: None}),
            "mkdir": partial(self._renamed, "mkdir", lambda name: {name: _DIRECTORY}),
            "rmdir": partial(self._renamed, "rmdir", lambda name: {name: None}),
        }
        for name in filter(ours.__contains__, dir(os)):  # Windows has not all of them
            self._plain[name] = getattr(os, name)
            setattr(os, name, ours[name])
        self._plain_open, io.open = io.open, self._file_object  # put back
        return self

    def __exit__(self, *_: object) -> None:
        io.open = self._plain_open
        for name, plain in self._plain.items():
            setattr(os, name, plain)

    # --- what is left

    def now(self) -> DiskState:
        """Return the state for a program that starts after this one has died: the system keeps all its writes."""
        return next(self.after_power_cut())

    def after_power_cut(self, random: Random | None = None) -> Iterator[DiskState]:
        """Yield the states after a power cut at this moment, each once, the one with all writes first; or one drawn.

        A file that was replaced or taken away while another name is kept may have either's bytes.
        """
        if random is not None:
            names = random.choice(list(self._selections()))
            yield self._state(names, {each: random.choice(list(self._files[each].images())) for each in names.values()})
            return
        seen: set[frozenset[tuple[str, bytes | None]]] = set()
        for names in self._selections():
            numbers = sorted(set(names.values()) - {_DIRECTORY})
            for images in product(*(list(self._files[number].images()) for number in numbers)):
                state = self._state(names, dict(zip(numbers, images, strict=True)))
                if (key := frozenset(state.files.items())) not in seen:
                    seen.add(key)
                    yield state

    def _selections(self) -> Iterator[dict[str, int]]:
        """Yield the names that a power cut may leave, all first."""
        for chosen in product(*(list(_selected(pending)) for pending in self._naming.values())):
            names = dict(self._named)
            for naming in chain(*chosen):
                _apply(names, naming)
            yield {
                name: names[name]
                for name in names
                if all(str(above) in names for above in list(Path(name).parents)[:-1])
            }

    def _state(self, names: Mapping[str, int], images: Mapping[int, bytes]) -> DiskState:
        return DiskState({name: images[number] if number != _DIRECTORY else None for name, number in names.items()})

    # --- what is done

    def _name(self, path: Any) -> str | None:
        """Return a path in the folder, "" for itself, None elsewhere."""
        if isinstance(path, int) or self.stopped:
            return None
        whole, folder = str(os.path.abspath(os.fspath(path))), str(self.folder)  # noqa: PTH100  # as above
        return whole[len(folder) + 1 :] if f"{whole}{os.sep}".startswith(folder + os.sep) else None

    def _count(self, what: str) -> float | None:
        self.operations += 1
        return self._before(self.operations, what)

    def _fresh(self, data: bytes = b"") -> int:
        number = len(self._files)
        self._files[number] = _File(data)
        return number

    def _note_names(self, names: dict[str, int | None]) -> None:
        """Note names given and taken away at once, in the directory of the first."""
        if not self.stopped:
            self._naming.setdefault(os.path.dirname(next(iter(names))), []).append(names)  # noqa: PTH120
            _apply(self._numbers, names)

    def _note(self, descriptor: int, change: _Change) -> None:
        if not self.stopped:
            file = self._files[self._open[descriptor][1]]
            file.pending = (*file.pending, change)

    def _opened(self, path: Any, flags: int, *more: Any, **named: Any) -> int:
        name = self._name(path)
        made = name is not None and bool(flags & os.O_CREAT) and name not in self._numbers
        if made:
            self._count("open")
        descriptor = int(self._plain["open"](path, flags, *more, **named))
        if name is not None:
            if made:
                self._note_names({name: self._fresh()})
            self._open[descriptor] = (name, self._numbers.get(name, _DIRECTORY))
            if flags & os.O_TRUNC and not made:
                self._note(descriptor, _Change(0, None))
        return descriptor

    def _closed(self, descriptor: int) -> None:
        self._open.pop(descriptor, None)
        self._plain["close"](descriptor)

    def _written(self, descriptor: int, data: Any) -> int:
        if descriptor not in self._open:
            return int(self._plain["write"](descriptor, data))
        taken, part = bytes(data), self._count("write")
        if part is not None:
            taken = taken[: int(part * len(taken))]
        count = int(self._plain["write"](descriptor, taken))
        self._note(descriptor, _Change(os.lseek(descriptor, 0, os.SEEK_CUR) - count, taken[:count]))
        return count

    def _truncated(self, descriptor: int, length: int) -> None:
        if descriptor in self._open:
            self._count("ftruncate")
            self._note(descriptor, _Change(length, None))
        self._plain["ftruncate"](descriptor, length)

    def _synchronised(self, what: str, descriptor: int) -> None:
        if descriptor not in self._open or self.stopped:
            self._plain[what](descriptor)
            return
        self._count(what)  # whether it is on a disk matters to nobody
        name, number = self._open[descriptor]
        if number != _DIRECTORY:
            file = self._files[number]
            file.kept, file.pending = _changed(file.kept, file.pending), ()
            return
        for naming in self._naming.pop(name, ()):
            _apply(self._named, naming)

    def _renamed(self, what: str, naming: Callable[..., dict[str, int | None]], *given: Any, **more: Any) -> None:
        """Perform a call that creates, renames or removes a name, and record the change of the directory."""
        paths = given[: 2 if what in _OF_TWO else 1]
        names = [self._name(path) for path in paths]
        if names[0] is not None:
            self._count(what)
        self._plain[what](*given, **more)
        if None not in names:
            self._note_names(naming(*names))

    def _file_object(self, file: Any, mode: str = "r", *more: Any, **named: Any) -> Any:
        """Open a file; writes to it come through here."""
        if not set(mode) & set("wxa+") or self._name(file) is None:
            return self._plain_open(file, mode, *more, **named)
        raw: Any = _Raw(file, mode)
        binary: Any = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return binary if "b" in mode else io.TextIOWrapper(binary, encoding="utf-8", newline="\n")


def _apply(names: dict[str, int], naming: Mapping[str, int | None]) -> None:
    for name, number in naming.items():
        if number is None:
            names.pop(name, None)
        else:
            names[name] = number


def _selected(pending: Sequence[Mapping[str, int | None]]) -> Iterator[Sequence[Mapping[str, int | None]]]:
    if len(pending) <= _MOST:
        for size in range(len(pending), -1, -1):
            yield from combinations(pending, size)
        return
    for number in range(len(pending), -1, -1):
        yield pending[:number]
        yield [*pending[: number - 1], *pending[number:]]


class _Raw(io.RawIOBase):
    """A file whose bytes go through the functions of `os`."""

    _FLAGS: ClassVar = {
        "w": os.O_CREAT | os.O_TRUNC,
        "x": os.O_CREAT | os.O_EXCL,
        "a": os.O_CREAT | os.O_APPEND,
        "r": 0,
    }

    _descriptor = -1

    def __init__(self, path: Any, mode: str) -> None:
        both = os.O_RDWR if "+" in mode else os.O_WRONLY
        kind = next(flags for letter, flags in self._FLAGS.items() if letter in mode)
        self._descriptor = os.open(path, both | kind | getattr(os, "O_BINARY", 0), 0o666)
        self._reads = "+" in mode

    def fileno(self) -> int:
        return self._descriptor

    def readable(self) -> bool:
        return self._reads

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = os.read(self._descriptor, len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def write(self, data: Any) -> int:
        return os.write(self._descriptor, data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return os.lseek(self._descriptor, offset, whence)

    def truncate(self, size: int | None = None) -> int:
        length = os.lseek(self._descriptor, 0, os.SEEK_CUR) if size is None else size
        os.ftruncate(self._descriptor, length)
        return length

    def close(self) -> None:
        if not self.closed:
            super().close()
            if self._descriptor >= 0:  # else it could not be opened
                os.close(self._descriptor)
