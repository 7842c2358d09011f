# noqa: INP001 - a script, not a package
"""Puts what `vcfbench run virtual-coriolis` prints on the embedded bench into the README's first text block."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
COMMAND = [sys.executable, "-c", "from vcfbench.cli.main import main; main()", "run", "virtual-coriolis", "--quiet"]


def printed() -> str:
    """Run the command in an empty directory; the name of the record, different each time, is left out."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(COMMAND, cwd=folder, capture_output=True, encoding="utf-8", check=True)  # noqa: S603
    return "\n".join(line.rstrip() for line in done.stdout.splitlines() if not line.startswith("record:")).strip()


def main() -> None:
    """Rewrite the README."""
    text = README.read_text(encoding="utf-8")
    block = f"```text\n{printed()}\n```"
    README.write_text(
        re.sub(r"```text\n.*?```", lambda _: block, text, count=1, flags=re.DOTALL), encoding="utf-8", newline="\n"
    )


if __name__ == "__main__":
    main()
