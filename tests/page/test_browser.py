"""The page as a browser shows it: what is to be seen, on a desk and on a phone, in light and dark."""

from __future__ import annotations

import json
import shutil
import socket
from contextlib import ExitStack, closing, suppress
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests.cli.test_page import started
from tests.page.test_panel import PLAN
from vcfbench.clock import WallClock, sleep

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

playwright = pytest.importorskip("playwright.sync_api", reason="pip install 'vcfbench[dev]'")
pytest.importorskip("uvicorn", reason="pip install 'vcfbench[page]'")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking", "--disable-sync"]
WAIT_MS = 60_000
SCREENS = [(1440, 900, "light"), (1440, 900, "dark"), (390, 844, "light"), (390, 844, "dark")]

pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield opened
        opened.close()


class Looked:
    """A page that somebody looks at, and what went wrong in it."""

    def __init__(self, browser: Any, address: str, screen: tuple[int, int, str] = SCREENS[0]) -> None:
        width, height, scheme = screen
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        context.set_default_timeout(WAIT_MS)
        self.page = context.new_page()
        self.wrong: list[str] = []
        self.asked: set[str] = set()
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        self.page.on("request", lambda request: self.asked.add(request.url))
        self.page.goto(address)

    def text(self, selector: str) -> str:
        return str(self.page.inner_text(selector))

    def wait(self, selector: str) -> None:
        self.page.wait_for_selector(selector)

    def is_too_wide(self) -> bool:
        return bool(self.page.evaluate("document.documentElement.scrollWidth > innerWidth"))


def test_several_browsers_follow_run_to_its_end(browser: Any, tmp_path: Path) -> None:
    words = ("run", "virtual-coriolis", "--speed", "15", "--page", "--quiet")  # 45 s: late screens must come in time
    with started(tmp_path, *words) as (process, address):
        first = Looked(browser, address)
        first.wait("#residuals canvas")
        late = [Looked(browser, address, screen) for screen in SCREENS[1:]]
        for each in (first, *late):
            each.wait("#residuals canvas")
            each.wait("#steps li.now")
            assert each.text("#status") == "running"
            assert "left, ends" in each.text("#left")
            assert each.text("#rails") == "+10.005, -9.992 V"
            assert "max rate" in each.text("#limits")
            assert not each.is_too_wide()
        process.wait()
        assert process.returncode == 0
    for each in (first, *late):
        each.wait("#parts table")
        assert each.text("#status") == "complete"
        assert "The run is over: complete. Record: runs" in each.text("#over")
        assert "K_Vc = 150." in each.text("#parts")
        assert each.page.locator("#steps > li.done").count() == 6
        assert each.page.locator("#parts canvas").count() == 3
        assert not each.is_too_wide()
        assert not each.page.is_visible("#stop")
        assert all(url.startswith(address.split("/run/")[0]) for url in each.asked)
        assert [said for said in each.wrong if "ERR_CONNECTION_REFUSED" not in said] == []


def test_the_stop_button_asks_and_stops(browser: Any, tmp_path: Path) -> None:
    with started(tmp_path, "run", "turntable", "--speed", "10", "--page", "--quiet") as (process, address):
        only_looks = Looked(browser, address.split("#")[0])
        looked = Looked(browser, address)
        looked.wait("#readings canvas")
        assert not only_looks.page.is_visible("#stop")
        looked.page.click("#stop")
        looked.page.click("#sure button[value=no]")
        assert process.poll() is None
        looked.page.click("#stop")
        looked.page.click("#sure button[value=yes]")
        process.communicate(timeout=60)
        assert process.returncode == 4
        for each in (looked, only_looks):
            each.wait("#status.aborted")
            assert "stopped by the page" in each.text("#over")


def test_a_run_whose_command_died_is_said_to_be_lost(browser: Any, tmp_path: Path) -> None:
    with started(tmp_path, "run", "turntable", "--speed", "10", "--page", "--quiet") as (process, address):
        looked = Looked(browser, address)
        looked.wait("#readings canvas")
        process.kill()
        looked.wait("#status.lost")
        assert "does not answer any more" in looked.text("#over")


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    folder = tmp_path_factory.mktemp("station")
    done = vcfbench.run("kvc", "lab", runs=folder / "runs", settings={"dut": "G7", "devices": str(folder / "devices")})
    assert done.directory is not None
    million(done.directory / "journal.jsonl", folder / "runs" / "20260101T000000Z-zero-000000")
    with started(folder, "page", "--port", "0", said_on="stdout") as (_, address):
        yield address, folder


def million(source: Path, folder: Path) -> None:
    """Put the record of a window of a million readings into `folder`."""
    lines = [json.loads(line) for line in source.read_text("utf-8").splitlines()]
    header, footer = lines[0], lines[-1]
    window = next(line for line in lines if line.get("step_kind") == "Acquire")
    chunk = {**window, "type": "readings", "n": 1}
    del chunk["result"], chunk["point"]
    folder.mkdir()
    with (folder / "journal.jsonl").open("w", encoding="utf-8") as file:
        print(json.dumps({**header, "run": folder.name}), file=file)
        for number in range(1000):
            readings = [{"t_s": 10.0 * number + 0.01 * each, "voltage_v": 1e-3 * (each % 10)} for each in range(1000)]
            whole = {**chunk, "t_s": 0.0, "end_s": 10.0 * number + 10.0, "chunk": number + 1, "readings": readings}
            print(json.dumps(whole, separators=(",", ":")).replace('"type"', '"type"', 1), file=file)
        print(json.dumps({**footer, "status": "aborted", "points": 0}), file=file)


@pytest.mark.parametrize("screen", SCREENS)
def test_the_station_shows_runs_and_devices(
    browser: Any, station: tuple[str, Path], screen: tuple[int, int, str]
) -> None:
    looked = Looked(browser, station[0], screen)
    looked.wait("#runs tbody tr:nth-child(2)")
    assert "kvc" in looked.text("#runs")
    looked.page.fill("#find", "G7 complete")
    assert looked.page.locator("#runs tbody tr").count() == 1
    looked.page.click("#devices summary")
    looked.wait("#devices td")
    assert "K_Vc" in looked.text("#devices")
    assert not looked.is_too_wide()
    assert looked.wrong == []
    looked.page.click("#runs a")
    looked.wait("#parts table")
    assert not looked.is_too_wide()
    assert looked.wrong == []


def test_a_million_readings_are_drawn_as_few(browser: Any, station: tuple[str, Path]) -> None:
    address, _ = station
    looked = Looked(browser, f"{address}run/20260101T000000Z-zero-000000")
    looked.wait("#readings-said:has-text('1,000,000 of 1,000,000')")
    looked.page.locator("#readings").scroll_into_view_if_needed()
    over = looked.page.query_selector("#readings .u-over").bounding_box()
    with looked.page.expect_response(lambda response: "from=" in response.url) as answer:
        looked.page.mouse.move(over["x"] + 100, over["y"] + 20)
        looked.page.mouse.down()
        looked.page.mouse.move(over["x"] + 300, over["y"] + 30)
        looked.page.mouse.up()
    body = answer.value.json()
    assert 50_000 < body["shown"] < 900_000
    assert len(body["t_s"]) <= 4000
    looked.page.click("#whole")
    looked.wait("#readings-said:has-text('1,000,000 of 1,000,000')")
    assert looked.wrong == []


def test_an_operator_measures_by_keyboard_alone(browser: Any, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN, "utf-8")
    words = ("panel", "plan.toml", "--port", "0", "--speed", "3")
    with started(tmp_path, *words, said_on="stdout") as (_, address):
        only_looks = Looked(browser, address.split("#")[0])
        screens = [Looked(browser, address, screen) for screen in [(820, 1180, "light"), *SCREENS]]
        first = screens[0]
        first.wait("#serial:focus")
        first.page.keyboard.type("G1\n")
        first.wait("#start:focus")
        assert first.text("#mounting .named") == "G1"
        first.page.keyboard.press("Enter")
        for each in (*screens, only_looks):
            each.wait("#measuring")
            each.wait("#doing:not(:empty)")
            assert each.page.is_enabled("#stop") is (each is not only_looks)
        for each in (*screens, only_looks):
            each.wait("#verdict-card")
            assert each.text("#verdict") == "DONE"
            assert "G1" in each.text("#sheet table")
            assert not each.is_too_wide()
        assert not only_looks.page.is_visible("#next")
        first.wait("#serial:focus")
        first.page.keyboard.type("G1\n")
        first.wait("text=G1 is measured already")
        assert [said for each in screens for said in each.wrong if "409" not in said] == []


class Relay:
    """A relay between browser and program, which can be cut, and can fall asleep with its connections open."""

    def __init__(self, port: int) -> None:
        self.asleep, self._up = False, port
        self._open: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self._made = [self._server]
        self.port = int(self._server.getsockname()[1])
        Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                down, _ = self._server.accept()
                self._made.append(down)
                if self.asleep:
                    down.close()
                    continue
                up = socket.create_connection(("127.0.0.1", self._up))
                self._open += [down, up]
                self._made.append(up)
                for one, other in ((down, up), (up, down)):
                    Thread(target=self._carry, args=(one, other), daemon=True).start()

    def _carry(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(65536):
                if one not in self._open:  # it slept: what is sent here is never heard again
                    return
                other.sendall(data)
            other.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        gone, self._open = self._open, []
        for each in gone:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def fall_asleep(self) -> None:
        self.asleep, self._open = True, []

    def close(self) -> None:
        for each in self._made:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()


@pytest.mark.parametrize("lost", ["cut once", "cut twice", "away for 10 s", "asleep"])
def test_stop_works_behind_relay_that_loses_connections(browser: Any, tmp_path: Path, lost: str) -> None:
    words = ("run", "turntable", "--speed", "2", "--page", "--quiet")
    with ExitStack() as kept, started(tmp_path, *words) as (process, address):
        port, clock = int(address.split(":")[2].split("/")[0]), WallClock()
        relay = kept.enter_context(closing(Relay(port)))
        looked = Looked(browser, address.replace(f":{port}/", f":{relay.port}/"))
        looked.wait("#status.running")
        for _ in range(2 if lost == "cut twice" else 1):
            if lost == "asleep":
                relay.fall_asleep()
            else:
                relay.asleep = lost == "away for 10 s"
                relay.cut()
            looked.wait("#status.lost")
            assert looked.page.is_visible("#stop")
            sleep(clock, 10.0 if relay.asleep else 0.0)
            relay.asleep = False
            looked.wait("#status.running")
            assert looked.page.is_visible("#stop")
        looked.page.click("#stop")
        looked.page.click("#sure button[value=yes]")
        process.communicate(timeout=60)
        assert process.returncode == 4
        looked.wait("#status.aborted")
