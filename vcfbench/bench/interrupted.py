"""Ctrl-C at a prompt, or the stop button of a notebook: the table of a bench that stays open comes to rest.

A script that is interrupted ends, and everything is made safe. At a prompt nothing ends: the table would go on turning
until somebody asks for it again.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType


def at_each_interrupt(act: Callable[[], None]) -> None:
    """Call `act` after each KeyboardInterrupt that reaches IPython, a notebook or Python's prompt.

    One that is pressed where nothing is done reaches Python's prompt, too; a notebook's kernel hears none then.
    """
    shell = sys.modules.get("IPython")
    running: Any = None if shell is None else shell.get_ipython()
    if running is not None:

        def after_cell(result: Any) -> None:
            if isinstance(getattr(result, "error_in_exec", None), KeyboardInterrupt):
                act()

        running.events.register("post_run_cell", after_cell)
    elif hasattr(sys, "ps1") or sys.flags.interactive:
        shown = sys.excepthook

        def excepthook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
            if issubclass(kind, KeyboardInterrupt):
                act()
            shown(kind, error, trace)

        sys.excepthook = excepthook
