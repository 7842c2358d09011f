"""The page as an ASGI application: shows runs and devices, and stops, pauses and resumes a run."""

import asyncio
import hmac
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, Final
from urllib.parse import urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vcfbench.archive.recorded import load_run
from vcfbench.archive.reported import full_report, title_of
from vcfbench.clock import WallClock
from vcfbench.errors import BenchError, ConfigError
from vcfbench.page.following import JournalFollower
from vcfbench.page.panel import Panel
from vcfbench.page.parts import end_of
from vcfbench.page.station import StationDirectories
from vcfbench.page.view import BrowserPosition, View
from vcfbench.records.journal import being_written
from vcfbench.reports.html_page import page_of
from vcfbench.safety.control import RunControl

LIVE: Final = "live"  # The name of the run of this process

_HERE = Path(__file__).parent
_TICK_S: Final = 0.2
_READING_S: Final = 0.3  # Time for which a journal is read before its view is told, s
_ALIVE_S: Final = 10.0
"""Interval in which a browser is told that somebody is there, s; its time-out for each message, too."""
_MOST_BROWSERS: Final = 32
_MOST_VIEWS: Final = 8
_MOST_POINTS: Final = 20_000
_MOST_TYPED: Final = 1000  # Bytes of a serial number or an answer
_BY: Final = "the page"

_DRAWING: Final = Lock()  # Matplotlib draws one figure at a time

_OF_REPORTS: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
"""A report has its style and figures in it, and no script."""

_SHEETS: Final = {
    "html": "text/html",
    "md": "text/markdown",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
}

_HEADERS: Final = {
    b"content-security-policy": b"default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    b"cache-control": b"no-store",
    b"cross-origin-resource-policy": b"same-origin",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
}


@dataclass(slots=True)
class PageContent:
    """Content of the page: a station, and the run of this process, if there is one.

    `live` is that run, `control` stops and pauses it, `panel` starts devices of a batch; `token` must be known for
    each. `closing` ends the streams that browsers follow.
    """

    station: StationDirectories
    live: View | None = None
    control: RunControl | None = None
    panel: Panel | None = None
    token: str = ""
    closing: bool = False
    browsers: int = 0
    follower: Callable[[str], JournalFollower] = field(init=False)
    """Gives the follower of the journal of a run by its name; ConfigError where there is none."""

    def __post_init__(self) -> None:
        """Keep the followers that were asked for last."""
        self.follower = lru_cache(_MOST_VIEWS)(lambda name: JournalFollower(self.station.directory(name).journal))

    def view(self, name: str) -> View:
        """Return the present state of the run called `name`."""
        if name == LIVE:
            if self.live is None:
                raise ConfigError("no run is under way here: see the station, /")
            return self.live
        follower = self.follower(name)
        try:
            clock = WallClock()
            while follower.read_on() and clock.now() < _READING_S:
                pass
            view = follower.view
            if view.end is not None and "parts" not in view.end:
                try:
                    ended = end_of(load_run(follower.path.parent))
                except BenchError as error:
                    ended = {"parts": [], "error": str(error)}
                view.finished({**view.end, **ended})
            elif view.end is None and not being_written(follower.path) and not follower.read_on() and view.end is None:
                view.finished({"status": "incomplete", "error": "the record ends here: its program has stopped"})
        except OSError as error:
            raise ConfigError(f"the record cannot be read: {error.strerror}") from error
        return follower.view


class EventStream:
    """Server-sent events: the run until now, then its events as they come, to its end.

    Nothing is kept for a browser but how much it has been told: one that is slow is told less often. One that takes
    nothing any more is let go.
    """

    def __init__(self, shown: PageContent, name: str) -> None:
        self._shown, self._name = shown, name

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one browser."""

        async def gone_from() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass

        self._shown.browsers += 1
        gone, events = asyncio.ensure_future(gone_from()), asyncio.ensure_future(self._tell(send))
        try:
            await asyncio.wait({gone, events}, return_when=asyncio.FIRST_COMPLETED)
            if events.done():
                events.result()
        except TimeoutError:  # it takes nothing any more
            pass
        finally:
            gone.cancel()
            events.cancel()
            self._shown.browsers -= 1

    async def _tell(self, send: Send) -> None:
        headers = [(b"content-type", b"text/event-stream; charset=utf-8")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        seen, silent_s, over = BrowserPosition(), 0.0, False
        live = self._shown.live if self._name == LIVE else None  # the next run of a sitting is another
        while not over:
            closing = self._shown.closing
            view = live if live is not None else await run_in_threadpool(self._shown.view, self._name)
            news = await run_in_threadpool(view.news, seen)
            end = None if news is None else news["end"]
            # nothing more will be said: the run is over, and its results are there if it has some
            over = closing or (end is not None and ("parts" in end or end.get("status") == "incomplete"))
            if over and news is not None:
                news["drawn"] = await run_in_threadpool(view.drawn, None, None, 4000)
            silent_s += _TICK_S
            if news is not None or silent_s >= _ALIVE_S or over:
                silent_s = 0.0
                event = "last" if over else "news"
                data = b"event: %b\ndata: %b\n\n" % (event.encode(), msgspec.json.encode(news))
                async with asyncio.timeout(_ALIVE_S):
                    await send({"type": "http.response.body", "body": data, "more_body": not over})
            if not over:
                await asyncio.sleep(_TICK_S)


class _Guarded:
    """Adds to every answer the headers that make a browser refuse other origins, frames, scripts from elsewhere."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message.get("headers", ())}
                added = [each for each in _HEADERS.items() if each[0] not in own]
                message["headers"] = [*message.get("headers", ()), *added]
            await send(message)

        await self._app(scope, receive, guarded)


def application(shown: PageContent) -> Starlette:
    """Return the application; it answers to no host name but that of this machine to itself."""
    routes = _Routes(shown)
    return Starlette(
        routes=[
            Route("/", routes.station_page),
            Route("/station", routes.station),
            Route("/device/{serial}", routes.device),
            Route("/batch/{name}/sheet.{kind}", routes.sheet),
            Route("/run/{name}", routes.run_page),
            Route("/run/{name}/events", routes.events),
            Route("/run/{name}/readings", routes.readings),
            Route("/run/{name}/report", routes.report),
            Route("/run/live/{act}", routes.run_act, methods=["POST"]),
            Route("/panel", routes.panel_page),
            Route("/panel/state", routes.panel_state),
            Route("/panel/{act}", routes.panel_act, methods=["POST"]),
            Mount("/assets", StaticFiles(directory=_HERE / "assets")),
            Mount("/vendor", StaticFiles(directory=_HERE / "vendor")),
        ],
        exception_handlers={BenchError: lambda _request, error: PlainTextResponse(str(error), 404)},
        middleware=[
            Middleware(_Guarded),
            Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"], www_redirect=False),
        ],
    )


class _Routes:
    """Routes of the page; plain functions in threads of the pool, where reading a record holds up nobody else."""

    def __init__(self, shown: PageContent) -> None:
        self._shown = shown

    def station_page(self, request: Request) -> Response:
        return FileResponse(_HERE / "assets" / "station.html")

    def station(self, request: Request) -> Response:
        return _json({**self._shown.station.listed(), "live": self._shown.live is not None})

    def device(self, request: Request) -> Response:
        return _json(self._shown.station.history(request.path_params["serial"]))

    def sheet(self, request: Request) -> Response:
        name, kind = request.path_params["name"], request.path_params["kind"]
        if kind not in _SHEETS:
            raise HTTPException(404, f"a sheet is one of {', '.join(_SHEETS)}")
        return _document(self._shown.station.sheet(name, kind), _SHEETS[kind])

    def run_page(self, request: Request) -> Response:
        name = request.path_params["name"]
        (self._shown.view if name == LIVE else self._shown.follower)(name)  # there is one
        return FileResponse(_HERE / "assets" / "run.html")

    def events(self, request: Request) -> Any:
        if self._shown.browsers >= _MOST_BROWSERS:
            raise HTTPException(503, f"{_MOST_BROWSERS} browsers show this already")
        name = request.path_params["name"]
        self._shown.view(name)  # there is one
        return EventStream(self._shown, name)

    def readings(self, request: Request) -> Response:
        view = self._shown.view(request.path_params["name"])
        first_s, last_s = _number(request, "from"), _number(request, "to")
        return _json(view.drawn(first_s, last_s, min(max(int(_number(request, "most") or 2000), 2), _MOST_POINTS)))

    def report(self, request: Request) -> Response:
        path = self._shown.station.directory(request.path_params["name"]).path
        with _DRAWING:
            run = load_run(path)
            return _document(page_of(full_report(run), title_of(run), path.name).encode(), _SHEETS["html"])

    async def run_act(self, request: Request) -> Response:
        """Stop, pause or continue the run of this process at once, even while many threads are busy."""
        self._require_token(request)
        control, live, panel = self._shown.control, self._shown.live, self._shown.panel
        stops_next = request.path_params["act"] == "stop" and panel is not None and panel.measures
        if control is None or live is None or (live.end is not None and not stops_next):
            raise HTTPException(409, "no run is under way here any more")
        if (named := request.query_params.get("run")) not in {None, "", (goes := str(live.about.get("run", "")))}:
            raise HTTPException(409, f"{named} is over, another run is under way here: {goes}")
        acts = {"stop": control.stop, "pause": control.pause, "go-on": control.go_on}
        _chosen(request, acts)(_BY)
        return _json({"state": control.state})

    def panel_page(self, request: Request) -> Response:
        self._panel()
        return FileResponse(_HERE / "assets" / "panel.html")

    def panel_state(self, request: Request) -> Response:
        return _json(self._panel().shown())

    async def panel_act(self, request: Request) -> Response:
        """Name a device, start it, or answer a question: the words come as the body."""
        self._require_token(request)
        panel, words = self._panel(), (await request.body())[:_MOST_TYPED].decode("utf-8", "replace")
        acts = {"name": lambda: panel.name(words), "start": panel.start, "answer": lambda: panel.answer(words)}
        try:
            await run_in_threadpool(_chosen(request, acts))
        except BenchError as error:
            raise HTTPException(409, str(error)) from error
        return _json(panel.shown())

    def _panel(self) -> Panel:
        if self._shown.panel is None:
            raise ConfigError("no panel is here: vcfbench panel PLAN.toml shows one")
        return self._shown.panel

    def _require_token(self, request: Request) -> None:
        token = self._shown.token
        origin, sent = request.headers.get("origin"), request.headers.get("x-vcfbench-token") or ""
        elsewhere = origin is not None and urlsplit(origin).netloc != request.headers.get("host")
        if elsewhere or not token or not hmac.compare_digest(sent.encode(), token.encode()):
            raise HTTPException(403, "this address only shows: open the address that the terminal prints")


def _number(request: Request, name: str) -> float | None:
    text = request.query_params.get(name)
    try:
        number = None if text is None else float(text)
    except ValueError:
        number = math.nan
    if number is not None and not math.isfinite(number):
        raise HTTPException(400, f"{name}: expected a number, got {text!r}")
    return number


def _chosen(request: Request, acts: Mapping[str, Callable[..., None]]) -> Callable[..., None]:
    """Return the act that the address names."""
    if (act := acts.get(request.path_params["act"])) is None:
        raise HTTPException(404, f"expected one of {', '.join(acts)}")
    return act


def _document(data: bytes, kind: str) -> Response:
    return Response(data, media_type=kind, headers={"content-security-policy": _OF_REPORTS})


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
