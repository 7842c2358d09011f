"""A prompt with history and tab completion, where the system has a readline."""

import os
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import readline
except ImportError:  # Windows has none
    readline = None  # type: ignore[assignment]

from collections.abc import Callable, Iterator, Sequence


@contextmanager
def history(name: str, candidates: Callable[[], Sequence[str]] = list) -> Iterator[None]:
    """Keep typed lines from one conversation to the next under `name`; TAB completes the first word of a line."""
    if readline is None:
        yield
        return
    state = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME")
    try:
        path = (Path(state) if state else Path.home() / ".local" / "state") / "vcfbench" / name
    except RuntimeError:  # there is no home
        path = Path(tempfile.gettempdir()) / "vcfbench" / name
    readline.clear_history()
    with suppress(OSError):
        readline.read_history_file(path)
    before = readline.get_completer(), readline.get_completer_delims()

    def complete(text: str, state: int) -> str | None:
        fitting = [each for each in candidates() if each.startswith(text)] if readline.get_begidx() == 0 else []
        return f"{fitting[state]} " if state < len(fitting) else None

    readline.set_completer(complete)
    readline.set_completer_delims(" ")  # words have dots in them
    libedit = "libedit" in (readline.__doc__ or "")  # macOS
    readline.parse_and_bind("bind ^I rl_complete" if libedit else "tab: complete")
    try:
        yield
    finally:
        readline.set_completer(before[0])
        readline.set_completer_delims(before[1])
        readline.set_history_length(1000)
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            readline.write_history_file(path)
