# noqa: INP001 - a script, not a package
"""Puts the end of `vcfbench run virtual-coriolis` into the README, and a picture of a terminal in the middle of it.

The picture is what a terminal shows: the run has a pseudo-terminal, an emulator (pyte, in the extra `dev`) keeps its
screen, and that is drawn when the run has come to `SHOWN_AT`.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
from contextlib import suppress
from io import StringIO
from itertools import groupby
from pathlib import Path

import pyte
from rich.console import Console
from rich.style import Style
from rich.text import Text

README = Path(__file__).parents[1] / "README.md"
PICTURE = Path(__file__).with_name("run.svg")
COMMAND = "vcfbench run virtual-coriolis --speed 20"
SHOWN_AT = re.compile(r"^ 8[0-9] %")
ROWS, COLUMNS = 32, 80
FIRST_LINE = "quantity"


def vcfbench(command: str) -> list[str]:
    """Return the words that start `command` with this Python."""
    return [sys.executable, "-m", *command.split()]


def results() -> str:
    """Return what a run ends with: the values, and the last line before the name of the record."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603
            vcfbench("vcfbench run virtual-coriolis --quiet"), cwd=folder, stdout=subprocess.PIPE, text=True, check=True
        )
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    start = next(number for number, line in enumerate(lines) if line.startswith(FIRST_LINE))
    fits = lines[start : lines.index("", start)]
    return "\n".join([*fits, "...", *(line for line in lines if line.startswith("complete:"))])


def screen_of_a_run() -> pyte.Screen:
    """Run the command on a terminal; return its screen when the run has come to `SHOWN_AT`."""
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    stream.feed(f"$ {COMMAND}\r\n".encode())
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    unset = {"COLUMNS", "LINES", "NO_COLOR"}
    environment = {**{k: v for k, v in os.environ.items() if k not in unset}, "TERM": "xterm-256color"}
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(  # noqa: S603
            vcfbench(COMMAND), cwd=folder, env=environment, stdin=its, stdout=its, stderr=its
        ) as process,
    ):
        os.close(its)
        while not any(SHOWN_AT.match(line) for line in screen.display):
            stream.feed(os.read(ours, 100_000))
        process.terminate()
        with suppress(OSError):  # nobody has the other end any more
            while os.read(ours, 100_000):
                pass
    return screen


def draw(screen: pyte.Screen) -> None:
    """Draw a screen as it is, colours and all."""
    console = Console(record=True, width=COLUMNS, file=StringIO(), highlight=False)
    for row in range(ROWS):
        line = Text()
        cells = (screen.buffer[row][column] for column in range(COLUMNS))
        for (colour, bold), alike in groupby(cells, key=lambda cell: (cell.fg.replace("brown", "yellow"), cell.bold)):
            line.append("".join(cell.data for cell in alike), Style(color=colour, bold=bold))
        console.print(line, no_wrap=True, overflow="crop")
    console.save_svg(str(PICTURE), title="vcfbench", unique_id="run")


def main() -> None:
    """Rewrite README and picture."""
    draw(screen_of_a_run())
    block = f"```text\n{results()}\n```"
    text = README.read_text(encoding="utf-8")
    shown = re.compile(rf"```text\n{FIRST_LINE}.*?```", re.DOTALL)
    README.write_text(shown.sub(lambda _: block, text, count=1), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
