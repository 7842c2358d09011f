"""What a command loads is not looked through for garbage while it is loaded."""

from __future__ import annotations

import subprocess
import sys

COUNTED = """
import gc
begun = []
gc.callbacks.append(lambda phase, info: begun.append(info) if phase == "start" else None)
import vcfbench.cli.main
print(len(begun))
"""


def test_loading_the_command_line_collects_next_to_nothing() -> None:
    done = subprocess.run([sys.executable, "-c", COUNTED], capture_output=True, text=True, check=True)  # noqa: S603
    assert int(done.stdout) <= 5, "31 at the pace of Python"
