"""The operator's panel: what it takes when, and from whom."""

from __future__ import annotations

import signal
import sys
import threading
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from vcfbench.cli import panel as command
from vcfbench.cli.ending import Stopped
from vcfbench.errors import BenchError, ConfigError, NotSafe
from vcfbench.interfaces import Request
from vcfbench.page.panel import Panel
from vcfbench.page.view import View
from vcfbench.runs.batch import read_batch
from vcfbench.safety.control import RunControl
from vcfbench.safety.signals import StopSignals

pytest.importorskip("starlette", reason="pip install 'vcfbench[page]'")
pytest.importorskip("httpx", reason="pip install 'vcfbench[dev]'")

from tests.page.test_app import HERE, Client
from vcfbench.page.app import PageContent
from vcfbench.page.station import StationDirectories

if TYPE_CHECKING:
    from pathlib import Path

ADDRESS_END = "known"
PLAN = """name = "lot-8"
bench = "ideal"
operator = "A. Person"
devices = ["G1", "G2"]
[[runs]]
procedure = "turntable"
settings = { samples = 2, rates_deg_s = [-10, 0, 10] }
"""


@pytest.fixture
def panel(tmp_path: Path) -> Panel:
    (tmp_path / "plan.toml").write_text(PLAN, "utf-8")
    return Panel(read_batch(tmp_path / "plan.toml"), tmp_path / "runs")


def test_device_is_named_mounted_measured_and_judged(panel: Panel) -> None:
    assert panel.shown()["state"] == "serial"
    with pytest.raises(ConfigError, match="the panel is in the state serial"):
        panel.start()
    panel.name("G2")
    panel.name(" G1\n")  # another one after all, with what a scanner sends behind it
    assert (panel.shown()["state"], panel.shown()["serial"]) == ("mounting", "G1")
    panel.start()
    assert panel.next_device() == "G1"
    for too_early in (panel.start, lambda: panel.name("G2"), lambda: panel.answer("done")):
        with pytest.raises(ConfigError, match="the panel is in the state measuring"):
            too_early()
    view = View(planned_s=60.0, t_s=12.0, began_s=2.0, doing={"what": "ramp"}, control="running", about={"run": "R"})
    panel.begin("turntable", 1, 2, view)
    run = {"procedure": "turntable", "number": 1, "of": 2, "t_s": 10.0, "planned_s": 60.0, "doing": "ramp"}
    assert panel.shown()["run"] == {**run, "run": "R", "control": "running"}
    panel.judge("FAIL", "turntable: FAIL")
    shown = panel.shown()
    assert (shown["state"], shown["verdict"]) == ("verdict", {"word": "FAIL", "why": "turntable: FAIL", "run": None})
    assert "run" not in shown
    panel.name("G2")
    assert panel.shown()["verdict"] is None


def test_unmeasurable_device_is_refused_before_mounting(panel: Panel, tmp_path: Path) -> None:
    for wrong, words in ((" ", "expected a serial number, got an empty one"), ("G3", "G3 is not in the plan: G1, G2")):
        with pytest.raises(ConfigError, match=words):
            panel.name(wrong)
    settings = {"samples": 2, "rates_deg_s": [-10, 0, 10]}
    told = {"dut": "G1", "tags": {"batch": "lot-8"}}
    vcfbench.run("turntable", "ideal", settings=settings, runs=tmp_path / "runs", metadata=told)
    with pytest.raises(ConfigError, match="G1 is measured already"):
        panel.name("G1")
    assert panel.shown()["left"] == ["G1", "G2"]
    panel.judge("DONE")
    assert panel.shown()["left"] == ["G2"]
    assert [part["part"] for part in panel.shown()["sheet"]].count("table") == 1
    hasty = PLAN.replace("[-10, 0, 10]", "[-1000, 0, 1000]").replace('devices = ["G1", "G2"]', "")
    (tmp_path / "hasty.toml").write_text(hasty, "utf-8")
    with pytest.raises(BenchError, match="max_rate_deg_s"):
        Panel(read_batch(tmp_path / "hasty.toml"), tmp_path / "runs").name("G9")


def test_page_asks_for_work_by_hand(panel: Panel) -> None:
    panel.name("G1")
    panel.start()
    ask, said = panel.person(StopSignals()), list[str]()
    for words, types in ((" 24.1 ", "degC"), ("", "degC"), ("", "")):
        request = Request("read the thermometer", types=types)
        thread = Thread(target=lambda: said.append(ask(request)))  # noqa: B023  # over before the next one
        thread.start()
        while panel.shown()["state"] != "asking":
            pass
        assert panel.shown()["asked"] == "read the thermometer"
        panel.answer(words)
        thread.join()
    assert said == ["24.1", "", "done"]
    assert (panel.shown()["state"], panel.shown()["asked"]) == ("measuring", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no signal to a thread")
def test_signal_that_does_not_wake_the_panel_is_handled(panel: Panel) -> None:
    """As one that comes just before the waiting: here another thread takes it."""

    def stopped(*_: object) -> None:
        raise Stopped("SIGUSR1")

    before = signal.signal(signal.SIGUSR1, stopped)
    signalling = threading.Timer(0.2, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGUSR1))
    too_late = threading.Timer(20.0, panel._started.put, ["too late"])
    try:
        too_late.start()
        signalling.start()
        with pytest.raises(Stopped):
            panel.next_device()
        assert too_late.is_alive()
    finally:
        too_late.cancel()
        signalling.join()
        signal.signal(signal.SIGUSR1, before)


def test_after_a_bench_that_is_not_safe_nothing_is_started(
    panel: Panel, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It stays on the page until somebody ends the command, and the code says it then."""

    class Board(Panel):
        def next_device(self) -> str:
            boards.append(self)
            if len(boards) > 1:
                raise Stopped("SIGINT")
            return "G1"

    def left_live(*_: Any) -> Any:
        raise NotSafe("power: its outputs are on")

    boards: list[Board] = []
    monkeypatch.setattr(command, "Panel", Board)
    monkeypatch.setattr(command, "measured", left_live)
    with pytest.raises(NotSafe):
        command.panel(tmp_path / "plan.toml", runs=tmp_path / "runs", port=0)
    assert "its outputs are on" in capsys.readouterr().err
    assert (boards[0].shown()["state"], boards[0].shown()["verdict"]["word"]) == ("not safe", "NOT SAFE")
    with pytest.raises(ConfigError, match="the panel is in the state not safe"):
        boards[0].name("G2")
    assert panel.shown()["state"] == "serial"


def test_stop_between_two_runs_is_taken(panel: Panel, tmp_path: Path) -> None:
    station = StationDirectories(tmp_path / "runs", tmp_path / "devices")
    live, control = View(about={"run": "first"}), RunControl()
    shown = PageContent(station, panel=panel, token=ADDRESS_END, live=live, control=control)
    client, token = Client(shown), {"X-Vcfbench-Token": ADDRESS_END}
    panel.name("G1")
    panel.start()
    panel.begin("turntable", 1, 2, live)
    live.finished({"status": "complete", "parts": []})
    assert client.post("/run/live/pause", headers=token).status_code == 409
    assert client.post("/run/live/stop", headers=token).status_code == 200
    assert control.stop_by == "the page"
    panel.judge("STOPPED")
    assert client.post("/run/live/stop", headers=token).status_code == 409


def test_only_who_knows_the_address_starts_anything(panel: Panel, tmp_path: Path) -> None:
    station = StationDirectories(tmp_path / "runs", tmp_path / "devices")
    client, token = Client(PageContent(station, panel=panel, token=ADDRESS_END)), {"X-Vcfbench-Token": ADDRESS_END}
    assert "vcfbench panel" in client.get("/panel").text
    assert client.get("/panel/state").json()["batch"] == "lot-8"
    assert client.post("/panel/name", content="G1").status_code == 403
    assert client.post("/panel/name", content="G1", headers={**token, "Origin": "http://evil"}).status_code == 403
    assert client.post("/panel/name", content="G1", headers={**token, "Origin": HERE}).json()["state"] == "mounting"
    assert client.post("/panel/leave", headers=token).status_code == 404
    answer = client.post("/panel/answer", headers=token)
    assert (answer.status_code, answer.text) == (409, "the panel is in the state mounting: reload it")
    assert client.post("/panel/start", headers=token).json()["state"] == "measuring"
    assert Client(PageContent(station, token=ADDRESS_END)).get("/panel").status_code == 404
