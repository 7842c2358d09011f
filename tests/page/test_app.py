"""What the page answers, and what it refuses."""

from __future__ import annotations

import asyncio
import gc
import json
import socket
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from vcfbench.clock import WallClock, sleep
from vcfbench.page.view import View
from vcfbench.safety.control import RunControl

pytest.importorskip("starlette", reason="pip install 'vcfbench[page]'")
httpx = pytest.importorskip("httpx", reason="pip install 'vcfbench[dev]'")
to_thread = pytest.importorskip("anyio.to_thread", reason="starlette's pool of threads")

from vcfbench.page import app as page_app  # noqa: E402
from vcfbench.page import connections  # noqa: E402
from vcfbench.page.app import EventStream, PageContent, application  # noqa: E402
from vcfbench.page.parts import end_of, parts_of  # noqa: E402
from vcfbench.page.server import LivePage  # noqa: E402
from vcfbench.page.station import StationDirectories  # noqa: E402
from vcfbench.records.directory import create_run  # noqa: E402
from vcfbench.records.journal import Journal  # noqa: E402
from vcfbench.reports.document import Axis, Column, Figure, Heading, Notice, Report, Series, Table, Text  # noqa: E402

if TYPE_CHECKING:
    from vcfbench.archive.run import Run

HERE = "http://127.0.0.1:8330"


class Client:
    """Asks the application, one question after the other."""

    def __init__(self, shown: PageContent) -> None:
        self._app = application(shown)

    def request(self, method: str, path: str, **options: Any) -> Any:
        async def ask() -> Any:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(self._app), base_url=HERE) as client:
                return await client.request(method, path, **options)

        return asyncio.run(ask())

    def get(self, path: str, **options: Any) -> Any:
        return self.request("GET", path, **options)

    def post(self, path: str, **options: Any) -> Any:
        return self.request("POST", path, **options)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    folder = tmp_path_factory.mktemp("station")
    return folder, vcfbench.run("turntable", runs=folder / "runs", metadata={"dut": "G7"})


@pytest.fixture
def shown(made: tuple[Path, Run]) -> PageContent:
    folder, _ = made
    return PageContent(StationDirectories(folder / "runs", folder / "devices"))


@pytest.fixture
def client(shown: PageContent) -> Client:
    return Client(shown)


def events(client: Client, run: str) -> list[dict[str, Any]]:
    """Return what a browser is told of a run that is over."""
    body = client.get(f"/run/{run}/events").text
    return [json.loads(line.removeprefix("data: ")) for line in body.splitlines() if line.startswith("data: ")]


def test_the_station_lists_its_runs(client: Client, made: tuple[Path, Run]) -> None:
    listed = client.get("/station").json()
    (row,) = listed["runs"]
    assert (row["run"], row["status"], row["dut"]) == (made[1].name, "complete", "G7")
    assert row["values"][0]["name"] == "scale factor"
    assert (listed["devices"], listed["older"], listed["live"]) == ([], 0, False)


def test_a_recorded_run_is_told_whole_and_at_once(client: Client, made: tuple[Path, Run]) -> None:
    (last,) = events(client, str(made[1].name))
    assert len(last["points"]) == 17
    assert last["end"]["status"] == "complete"
    assert last["end"]["parts"] == json.loads(json.dumps(parts_of(made[1].report())))
    assert last["drawn"]["count"] == 190


def test_a_recorded_run_has_its_whole_report(client: Client, made: tuple[Path, Run]) -> None:
    answer = client.get(f"/run/{made[1].name}/report")
    assert answer.status_code == 200
    assert "<svg" in answer.text
    assert "script" not in answer.headers["content-security-policy"]
    assert answer.headers["content-security-policy"].startswith("default-src 'none';")
    assert client.get("/run/live/report").status_code == 404


def test_a_batch_has_its_sheet(tmp_path: Path) -> None:
    for serial in ("G1", "G2"):
        about = {"dut": serial, "tags": {"batch": "lot 8"}}
        vcfbench.run("turntable", seed=1, settings={"samples": 2}, metadata=about, runs=tmp_path)
    station = StationDirectories(tmp_path, tmp_path)
    assert [row["batch"] for row in station.listed()["runs"]] == ["lot 8", "lot 8"]
    asked = Client(PageContent(station))
    answer = asked.get("/batch/lot%208/sheet.html")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    assert "Yield: 2 of 2" in answer.text
    assert answer.headers["content-security-policy"].startswith("default-src 'none';")
    assert asked.get("/batch/lot%208/sheet.md").text.startswith("# Batch lot 8")
    for nothing in ("/batch/lot%209/sheet.html", "/batch/lot%208/sheet.exe", "/batch/lot%208/sheet.%00html"):
        assert asked.get(nothing).status_code == 404


def test_a_record_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    folder = tmp_path / "20260101T000000Z-turntable-000000"
    folder.mkdir()
    (folder / "journal.jsonl").write_text('{"type":"header","format":99}\n', "utf-8")
    (row,) = StationDirectories(tmp_path, tmp_path).listed()["runs"]
    assert (row["run"], row["status"]) == (folder.name, "unreadable")
    assert "format 99" in row["problem"]


def test_a_run_that_goes_on_is_listed_as_running(tmp_path: Path) -> None:
    directory = create_run(tmp_path, "turntable")
    station = StationDirectories(tmp_path, tmp_path)
    assert station.listed()["runs"] == []
    journal = Journal(directory.journal)
    journal.header({"run": directory.run, "procedure": "turntable", "bench": {"name": "b"}, "metadata": {"dut": "G7"}})
    (row,) = station.listed()["runs"]
    assert (row["status"], row["procedure"], row["bench"], row["dut"]) == ("running", "turntable", "b", "G7")
    journal.close()
    assert station.listed()["runs"][0]["status"] == "incomplete"


def test_readings_are_thinned_out_and_cut(client: Client, made: tuple[Path, Run]) -> None:
    answer = client.get(f"/run/{made[1].name}/readings", params={"from": 10, "to": 100, "most": 20}).json()
    assert len(answer["t_s"]) <= 20
    assert answer["count"] == 190
    assert client.get(f"/run/{made[1].name}/readings", params={"from": "x"}).status_code == 400


@pytest.mark.parametrize("path", ["/", "/assets/run.js", "/assets/page.css", "/vendor/uplot/uPlot.iife.min.js"])
def test_every_answer_forbids_what_is_from_elsewhere(client: Client, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"].startswith("default-src 'self';")
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8330", "127.0.0.1.evil.example", "192.168.0.7"])
@pytest.mark.parametrize("path", ["/", "/station", "/run/live/events", "/run/live/stop"])
def test_other_host_names_are_refused(client: Client, host: str, path: str) -> None:
    """A name that somebody else has made to be this address is no way in."""
    ask = client.post if path.endswith("stop") else client.get
    assert ask(path, headers={"Host": host}).status_code == 400


@pytest.mark.parametrize("asked", ["most=nan", "most=inf", "from=nan", "to=1e400", "most=x"])
def test_what_is_no_number_is_refused(client: Client, made: tuple[Path, Run], asked: str) -> None:
    assert client.get(f"/run/{made[1].name}/readings?{asked}").status_code == 400


@pytest.mark.parametrize(
    "path", ["/run/none", "/run/none/events", "/run/live", "/run/live/events", "/run/..%2f/events", "/device/x"]
)
def test_what_is_not_there_is_not_found(client: Client, path: str) -> None:
    assert client.get(path).status_code == 404


def test_the_assets_are_no_way_to_other_files(client: Client) -> None:
    for path in ("/assets/../app.py", "/assets/%2e%2e/app.py", "/vendor/..%2fapp.py", "/assets//etc/passwd"):
        assert client.get(path).status_code == 404


class Going:
    """A run that goes, and what was wanted of it."""

    def __init__(self, shown: PageContent) -> None:
        self.control = RunControl()
        self.wanted: list[tuple[str, str]] = []
        self.control.tell(lambda state, by: self.wanted.append((state.value, by)))
        shown.live, shown.token, shown.control = View(about={"run": "it"}), "secret", self.control


def test_who_knows_the_token_stops_the_run(client: Client, shown: PageContent) -> None:
    going = Going(shown)
    assert client.post("/run/live/stop", headers={"X-Vcfbench-Token": "secret"}).status_code == 200
    assert going.wanted == [("stopping", "the page")]


def test_a_stop_waits_for_no_report_that_is_drawn(shown: PageContent) -> None:
    going = Going(shown)

    async def ask() -> int:
        threads = to_thread.current_default_thread_limiter()
        for each in range(int(threads.total_tokens)):
            threads.acquire_on_behalf_of_nowait(str(each))
        transport = httpx.ASGITransport(application(shown))
        async with httpx.AsyncClient(transport=transport, base_url=HERE) as client:
            asked = client.post("/run/live/stop", headers={"X-Vcfbench-Token": "secret"})
            return int((await asyncio.wait_for(asked, 5.0)).status_code)

    assert asyncio.run(ask()) == 200
    assert going.wanted == [("stopping", "the page")]


def test_who_knows_the_token_has_it_pause_and_go_on(client: Client, shown: PageContent) -> None:
    going = Going(shown)
    secret = {"X-Vcfbench-Token": "secret"}
    assert client.post("/run/live/go-on", headers=secret).json() == {"state": "beginning"}
    assert client.post("/run/live/pause", headers=secret).json() == {"state": "pausing"}
    assert client.post("/run/live/pause", headers=secret).json() == {"state": "pausing"}
    client.post("/run/live/go-on", headers=secret)
    assert going.wanted == [("pausing", "the page"), ("beginning", "the page")]


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"X-Vcfbench-Token": ""},
        {"X-Vcfbench-Token": "secre"},
        {"X-Vcfbench-Token": "secret1"},
        {"X-Vcfbench-Token": "secret", "Origin": "http://evil.example"},
        {"X-Vcfbench-Token": "secret", "Origin": "http://127.0.0.1:9999"},
        {"X-Vcfbench-Token": "secret", "Origin": "null"},
    ],
)
def test_nobody_else_does(client: Client, shown: PageContent, headers: dict[str, str]) -> None:
    going = Going(shown)
    for what in ("stop", "pause", "go-on"):
        assert client.post(f"/run/live/{what}", headers=headers).status_code == 403
    assert going.wanted == []


def test_looking_changes_nothing(client: Client, shown: PageContent) -> None:
    going = Going(shown)
    for method in ("GET", "HEAD", "PUT", "DELETE", "OPTIONS"):
        answer = client.request(method, "/run/live/stop", headers={"X-Vcfbench-Token": "secret"})
        assert answer.status_code in {404, 405}
    assert going.wanted == []


def test_a_run_that_is_over_cannot_be_stopped(client: Client, shown: PageContent) -> None:
    going = Going(shown)
    assert shown.live is not None
    shown.live.finished({"status": "complete", "parts": []})
    assert client.post("/run/live/stop", headers={"X-Vcfbench-Token": "secret"}).status_code == 409
    assert going.wanted == []


def test_without_a_token_of_the_run_none_is_right(client: Client, shown: PageContent) -> None:
    assert shown.token == ""
    assert client.post("/run/live/stop", headers={"X-Vcfbench-Token": ""}).status_code == 403


@pytest.mark.exhaustive
def test_a_browser_that_takes_nothing_is_let_go(
    shown: PageContent, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(page_app, "_ALIVE_S", 0.05)
    Going(shown)
    sent: list[Any] = []

    async def receive() -> Any:
        await asyncio.Event().wait()

    async def send(message: Any) -> None:
        sent.append(message)
        if message["type"] == "http.response.body":
            await asyncio.Event().wait()

    asyncio.run(EventStream(shown, "live")({}, receive, send))
    assert len(sent) == 2
    assert shown.browsers == 0
    gc.collect()
    assert "never retrieved" not in caplog.text


def test_closed_browser_gets_no_more_events(shown: PageContent) -> None:
    Going(shown)

    async def receive() -> Any:
        return {"type": "http.disconnect"}

    async def send(_message: Any) -> None:
        await asyncio.sleep(0.0)

    async def watched() -> int:
        await EventStream(shown, "live")({}, receive, send)
        await asyncio.sleep(0.05)
        return len(asyncio.all_tasks()) - 1

    assert asyncio.run(watched()) == 0


def test_too_many_browsers_are_refused(client: Client, shown: PageContent) -> None:
    Going(shown)
    shown.browsers = 32
    assert client.get("/run/live/events").status_code == 503


def test_connections_are_few_and_must_ask(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Idle connections took every file descriptor of the run, which then could not make its bench safe."""
    monkeypatch.setattr(connections, "_MOST", 3)
    monkeypatch.setattr(connections, "_ASKING_S", 0.2)
    with LivePage(tmp_path, tmp_path, 0) as page, ExitStack() as stack:
        port = int(page.address.split(":")[2].split("/")[0])
        opened = [stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0)) for _ in range(6)]
        for each in opened:
            each.settimeout(5.0)
            with suppress(ConnectionResetError):
                assert each.recv(1) == b""
        assert httpx.get(page.address.split("run/")[0], timeout=5.0).status_code == 200


@pytest.mark.exhaustive
def test_stop_acts_at_once_in_flood_of_connections(tmp_path: Path) -> None:
    """They held it away until each had had its time to ask something."""
    with LivePage(tmp_path, tmp_path, 0) as page, ExitStack() as stack:
        page.follow(control := RunControl())
        address, token = page.address.split("#")
        port = int(address.split(":")[2].split("/")[0])
        for _ in range(connections._MOST):
            stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0))
        clock = WallClock()
        done = httpx.post(f"{address}/stop", headers={"X-Vcfbench-Token": token}, timeout=5.0)
        assert (done.status_code, control.stop_by) == (200, "the page")
        assert clock.now() < 0.5 * connections._ASKING_S


def test_page_stops_the_run_that_it_names(tmp_path: Path) -> None:
    """In a sitting one run follows the other, and who looks at the first has not seen the second."""
    with LivePage(tmp_path, tmp_path, 0) as page:
        page.follow(first := RunControl())
        page.view.about, page.view.version = {"run": "first"}, 1
        address, token = page.address.split("#")
        ask = partial(httpx.post, headers={"X-Vcfbench-Token": token}, timeout=5.0)
        with httpx.stream("GET", f"{address}/events", timeout=5.0) as stream:
            lines = stream.iter_lines()
            assert next(lines) == "event: news"
            one = page.view
            page.follow(second := RunControl())
            page.view.about, page.view.version = {"run": "second"}, 1
            late = ask(f"{address}/stop", params={"run": "first"})
            assert (late.status_code, late.text) == (409, "first is over, another run is under way here: second")
            assert (first.stop_by, second.stop_by) == ("", "")
            one.finished({"status": "complete", "parts": []})
            said = "\n".join(lines)
            assert "event: last" in said
            assert "second" not in said
        assert ask(f"{address}/stop", params={"run": "second"}).status_code == 200
        assert second.stop_by == "the page"


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="the descriptors of a process are counted there")
def test_a_burst_of_connections_takes_few_descriptors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(connections, "_MOST", 3)
    with LivePage(tmp_path, tmp_path, 0) as page, ExitStack() as stack:
        port = int(page.address.split(":")[2].split("/")[0])
        opened = [stack.enter_context(socket.socket()) for _ in range(200)]
        before, most = len(list(Path("/proc/self/fd").iterdir())), 0
        for each in opened:
            each.setblocking(False)  # noqa: FBT003
            each.connect_ex(("127.0.0.1", port))
        clock = WallClock()
        for _ in range(300):
            most = max(most, len(list(Path("/proc/self/fd").iterdir())))
            sleep(clock, 1e-3)
    assert most - before < 40


def test_a_report_is_told_in_plain_values() -> None:
    series = Series("output", [0.0, 1.0], [0.1, 0.2])
    report = Report(
        [
            Heading("Results"),
            Table([Column("rate", "deg/s", ".1f")], [[1.0]], title="t"),
            Text("<b>words</b>"),
            Notice("simulated"),
            Figure("f", Axis("rate", "deg/s"), Axis("output", "V"), [series]),
        ]
    )
    heading, table, text, notice, figure = parts_of(report)
    assert heading == {"part": "heading", "text": "Results", "level": 1}
    assert (table["columns"][0]["head"], table["rows"]) == ("rate / (deg/s)", (("1.0",),))
    assert text == {"part": "text", "text": "<b>words</b>", "verbatim": False}
    assert notice == {"part": "notice", "text": "simulated", "kind": "warning"}
    assert figure["series"][0]["y"] == (0.1, 0.2)


def test_what_a_run_came_to(made: tuple[Path, Run]) -> None:
    end = end_of(made[1])
    assert (end["status"], end["error"], end["verdict"]) == ("complete", None, None)
    assert end["record"] == str(made[1].directory)
