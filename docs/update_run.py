# noqa: INP001 - a script, not a package
"""Puts what `vcfbench run virtual-coriolis` prints on the embedded bench into the README, and a picture beside it."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from io import StringIO
from pathlib import Path

from rich.console import Console

README = Path(__file__).parents[1] / "README.md"
PICTURE = Path(__file__).with_name("run.svg")
COMMAND = [sys.executable, "-m", "vcfbench", "run", "virtual-coriolis"]
STEPS_SHOWN, COLUMNS = 24, 132


def run() -> tuple[list[str], str]:
    """Run the command in an empty directory; return its steps, and its results without the name of the record."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(COMMAND, cwd=folder, capture_output=True, encoding="utf-8", check=True)  # noqa: S603
    results = (line.rstrip() for line in done.stdout.splitlines() if not line.startswith("record:"))
    return done.stderr.splitlines(), "\n".join(results).strip()


def draw(steps: list[str], results: str) -> None:
    """Draw the first steps and the results as a terminal shows them."""
    console = Console(record=True, width=COLUMNS, file=StringIO(), highlight=False)
    console.print("$ vcfbench run virtual-coriolis", style="bold")
    for line in [*steps[:STEPS_SHOWN], "..."]:
        console.print(line, style="cyan" if "  * " in line else "", markup=False, overflow="ellipsis", no_wrap=True)
    console.print(results, markup=False)
    console.save_svg(str(PICTURE), title="vcfbench", unique_id="run")


def main() -> None:
    """Rewrite README and picture."""
    steps, results = run()
    draw(steps, results)
    text = README.read_text(encoding="utf-8")
    block = f"```text\n{results}\n```"
    README.write_text(
        re.sub(r"```text\n.*?```", lambda _: block, text, count=1, flags=re.DOTALL), encoding="utf-8", newline="\n"
    )


if __name__ == "__main__":
    main()
