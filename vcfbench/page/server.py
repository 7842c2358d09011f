"""The page's server: uvicorn, reachable from this machine alone, in its own thread."""

from __future__ import annotations

import secrets
import socket
from pathlib import Path
from threading import Thread
from typing import Final, Self

from vcfbench.archive.run import Run
from vcfbench.errors import BenchError, ConfigError
from vcfbench.extras import need
from vcfbench.page.following import introduce
from vcfbench.page.panel import Panel
from vcfbench.page.parts import end_of
from vcfbench.page.station import StationDirectories
from vcfbench.page.view import View
from vcfbench.runs.request import Prepared
from vcfbench.safety.control import RunControl

LOOPBACK: Final = "127.0.0.1"
_WHAT: Final = "the page in a browser"
_PARTING_S: Final = 1.5  # Time of browsers for the last of a run, s: the command does not wait for them any longer
_LOOKS_S: Final = 10.0
_TAKEN_AT_ONCE: Final = 8
"""Connections accepted in one go, each with a file descriptor, before the first can be refused."""


def _bound(port: int) -> socket.socket:
    """Return a socket on `port` of this machine, 0 for any that is free; ConfigError where it is taken."""
    listening = socket.socket()
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows, where the other one would share it
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((LOOPBACK, port))
        listening.listen()  # who comes before the server is there waits for it
    except OSError as error:
        listening.close()
        raise ConfigError(
            f"--port {port}: the page cannot use this port: {error.strerror}", hint="choose another, or 0 for any"
        ) from error
    return listening


class LivePage:
    """The page of a station and of the runs of this process, in a thread for which no run waits.

    Somebody who knows the token controls the run that goes: stops it, has it pause and go on. With a `panel` that
    person starts them, too.

    Raises:
        ConfigError: the port is taken, or what the page needs is not installed.
    """

    def __init__(self, runs: Path, devices: Path, port: int, panel: Panel | None = None) -> None:
        need("starlette", "page", _WHAT)
        uvicorn = need("uvicorn", "page", _WHAT)
        from vcfbench.page.app import PageContent, application  # noqa: PLC0415  # made of starlette
        from vcfbench.page.connections import BoundedConnection  # noqa: PLC0415  # made of uvicorn

        self.view, self.panel = View(), panel
        self._shown = PageContent(StationDirectories(runs, devices), panel=panel, token=secrets.token_urlsafe(12))
        how = {"log_config": None, "log_level": "critical", "access_log": False, "lifespan": "off", "ws": "none"}
        config = uvicorn.Config(
            application(self._shown), http=BoundedConnection, backlog=_TAKEN_AT_ONCE, timeout_graceful_shutdown=1, **how
        )
        self._server = uvicorn.Server(config)
        self._socket = _bound(port)
        self._thread = Thread(target=self._server.run, args=([self._socket],), name="page", daemon=True)

    @property
    def station(self) -> str:
        """Address to look at records and devices."""
        return f"http://{LOOPBACK}:{self._socket.getsockname()[1]}/"

    @property
    def address(self) -> str:
        """Address to look and stop: the token comes last, where no browser sends it."""
        what = "run/live" if self.panel is None else "panel"
        return f"{self.station}{what}#{self._shown.token}"

    def follow(self, control: RunControl) -> None:
        """Show from now on the run that `control` controls."""
        self.view = View()
        self._shown.live, self._shown.control = self.view, control
        control.tell(self.view.hear)

    @property
    def was_stopped(self) -> bool:
        """Return True if the page has stopped the shown run, and not the whole program."""
        return self._shown.control is not None and bool(self._shown.control.stop_by)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Tell the browsers that the run is over, and go."""
        if self.view.end is None:
            self.view.finished({"status": "aborted", "error": str(error[1] or "the command ended")})
        self._shown.closing = self._server.should_exit = True
        self._thread.join(_PARTING_S)

    def begin(self, prepared: Prepared) -> None:
        """Take in the beginning of a run."""
        introduce(self.view, prepared)

    def wait(self) -> None:
        """Wait as long as the page is served; BenchError where that ends by itself."""
        while self._thread.is_alive():
            self._thread.join(_LOOKS_S)
        raise BenchError("the server of the page ended by itself")

    def ended(self, run: Run) -> None:
        """Show the end of the run."""
        self.view.finished(end_of(run))
