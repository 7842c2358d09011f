# noqa: INP001 - a script, not a package
"""Puts the end of `vcfbench run virtual-coriolis` into the README, and a moving picture of a terminal during it.

The picture shows the screens of a terminal one after another: the run has a pseudo-terminal, an emulator (pyte, in the
extra `dev`) keeps its screen, and that is drawn whenever the run has come to one of `SHOWN_AT`, and at its end.
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
from copy import deepcopy
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
SHOWN_AT = (re.compile(r"^ 1[0-9] %"), re.compile(r"^ 4[0-9] %"), re.compile(r"^ 8[0-9] %"))
SECONDS = 3  # Time for which each screen is shown
STILL = 2  # Number of the screen that is shown if nothing may move
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


def screens_of_a_run() -> list[pyte.Screen]:
    """Run the command on a terminal; return its screen at each of `SHOWN_AT`, and at the end."""
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    stream.feed(f"$ {COMMAND}\r\n".encode())
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    unset = {"COLUMNS", "LINES", "NO_COLOR"}
    environment = {**{k: v for k, v in os.environ.items() if k not in unset}, "TERM": "xterm-256color"}
    shown = []
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(vcfbench(COMMAND), cwd=folder, env=environment, stdin=its, stdout=its, stderr=its),  # noqa: S603
    ):
        os.close(its)
        with suppress(OSError):  # nobody has the other end any more
            while data := os.read(ours, 100_000):
                stream.feed(data)
                if len(shown) < len(SHOWN_AT) and any(SHOWN_AT[len(shown)].match(line) for line in screen.display):
                    shown.append(deepcopy(screen))
    return [*shown, screen]


def drawn(screen: pyte.Screen, number: int) -> str:
    """Return a screen as it is, colours and all, as SVG."""
    console = Console(record=True, width=COLUMNS, file=StringIO(), highlight=False)
    for row in range(ROWS):
        line = Text()
        cells = (screen.buffer[row][column] for column in range(COLUMNS))
        for (colour, bold), alike in groupby(cells, key=lambda cell: (cell.fg.replace("brown", "yellow"), cell.bold)):
            line.append("".join(cell.data for cell in alike), Style(color=colour, bold=bold))
        console.print(line, no_wrap=True, overflow="crop")
    return console.export_svg(title="vcfbench", unique_id=f"run{number}")


def moving(pictures: list[str]) -> str:
    """Return pictures of one size as one that shows them in turn."""
    whole, share = SECONDS * len(pictures), 100 / len(pictures)
    (size,) = re.findall(r'viewBox="([^"]+)"', pictures[0])
    styles = [
        f"@keyframes turn {{ 0% {{ visibility: visible }} {share:g}%, 100% {{ visibility: hidden }} }}",
        f".screen {{ animation: turn {whole}s step-end infinite }}",
        *(f".s{n} {{ visibility: hidden; animation-delay: {n * SECONDS}s }}" for n in range(len(pictures))),
        "@media (prefers-reduced-motion: reduce) {",
        f".screen {{ animation: none }} .s{STILL} {{ visibility: visible }} }}",
    ]
    screens = (f'<g class="screen s{n}">\n{picture}\n</g>' for n, picture in enumerate(pictures))
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}">'
    return "\n".join([head, "<style>", *styles, "</style>", *screens, "</svg>", ""])


def main() -> None:
    """Rewrite README and picture."""
    pictures = [drawn(screen, number) for number, screen in enumerate(screens_of_a_run())]
    PICTURE.write_text(moving(pictures), encoding="utf-8", newline="\n")
    block = f"```text\n{results()}\n```"
    text = README.read_text(encoding="utf-8")
    shown = re.compile(rf"```text\n{FIRST_LINE}.*?```", re.DOTALL)
    README.write_text(shown.sub(lambda _: block, text, count=1), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
