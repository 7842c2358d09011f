"""Files of a directory numbered in the order in which they were made, ``0001.json``: each whole, none replaced."""

import os
import re
import secrets
from collections.abc import Iterable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from vcfbench.files import synchronise_names

_NUMBERED = re.compile(r"(\d{4,})\.json", re.ASCII)


def numbered(directory: Path) -> list[tuple[int, Path]]:
    """Return the files with their numbers, in order."""
    try:
        found = [(match, path) for path in directory.iterdir() if (match := _NUMBERED.fullmatch(path.name))]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted((int(match[1]), path) for match, path in found)


def seal_of(paths: Iterable[Path]) -> str:
    """Return the SHA-256 of the SHA-256s of files, in hexadecimal: another as soon as one is changed or missing.

    Ends of lines may be those of Windows, as in other records.
    """
    texts = (path.read_bytes().replace(b"\r\n", b"\n") for path in paths)
    return sha256(b"".join(sha256(text).digest() for text in texts)).hexdigest()


def placed(directory: Path, data: bytes) -> Path:
    """Write a new file under the next number that is free, whole or not at all; return where."""
    draft = directory / f".draft-{secrets.token_hex(6)}"
    try:
        with draft.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        while True:
            number = max((taken for taken, _ in numbered(directory)), default=0) + 1
            path = directory / f"{number:04d}.json"
            with suppress(FileExistsError):  # another program took the number meanwhile
                # Give `draft` its name; FileExistsError if there is one of that name: an entry replaces no other
                if os.name == "nt":
                    draft.rename(path)  # which refuses there what it would replace elsewhere
                else:
                    path.hardlink_to(draft)
                for each in (directory, directory.parent, directory.parent.parent):  # they may be new
                    synchronise_names(each)
                return path
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
