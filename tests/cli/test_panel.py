"""`vcfbench panel` as a command: devices named, started and stopped as its page does."""

from __future__ import annotations

import json
import signal
import sys
import urllib.request
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.cli.test_page import started
from tests.page.test_panel import PLAN
from vcfbench.cli import batch
from vcfbench.cli.conduct import RunOptions
from vcfbench.clock import WallClock
from vcfbench.errors import Aborted
from vcfbench.page.panel import Panel
from vcfbench.runs.batch import read_batch

pytest.importorskip("uvicorn", reason="pip install 'vcfbench[page]'")

from vcfbench.page.server import LivePage  # needs uvicorn


class Operator:
    """Somebody at the panel."""

    def __init__(self, address: str) -> None:
        self._root, self._token = address.split("/panel#")

    def does(self, path: str, words: str = "") -> None:
        headers = {"X-Vcfbench-Token": self._token}
        request = urllib.request.Request(f"{self._root}{path}", words.encode(), headers, method="POST")  # noqa: S310
        urllib.request.urlopen(request, timeout=20).close()  # noqa: S310  # our own

    def sees(self, state: str) -> dict[str, Any]:
        clock = WallClock()
        while clock.now() < 60.0:
            with urllib.request.urlopen(f"{self._root}/panel/state", timeout=20) as answer:  # noqa: S310  # our own
                shown: dict[str, Any] = json.load(answer)
            if shown["state"] == state:
                return shown
        raise TimeoutError(f"not {state}: {shown}")


@pytest.mark.parametrize("stopped", [True, False])
def test_a_stop_after_one_run_keeps_the_next_from_beginning(
    *, stopped: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(PLAN + '[[runs]]\nprocedure = "zero"\nsettings = { duration_s = 60.0 }\n', "utf-8")
    asked, runs, begun = read_batch(file), tmp_path / "runs", list[str]()

    def conducted(request: Any, *rest: Any) -> Any:
        begun.append(request.procedure.name)
        with request.control.of_run(rest[2]):
            pass
        if stopped:  # while the results are calculated
            request.control.stop("the page")
        return SimpleNamespace(error=None, verdict=None, status=SimpleNamespace(value="complete"), directory=runs)

    monkeypatch.setattr(batch, "attended", conducted)
    monkeypatch.setattr(LivePage, "ended", lambda *_: None)
    ends = pytest.raises(Aborted, match="before zero began") if stopped else nullcontext()
    with LivePage(runs, tmp_path, 0, Panel(asked, runs)) as page, ends:
        batch.measured(asked, "G1", RunOptions(bench=Path(asked.bench), runs=runs, quiet=True), page)
    assert page.was_stopped is stopped  # else the panel takes it for its own end
    assert begun == ["turntable"] if stopped else begun == ["turntable", "zero"]


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to another process")
def test_an_operator_measures_stops_one_and_goes_on(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN, "utf-8")
    words = ("panel", "plan.toml", "--port", "0", "--speed", "30")
    with started(tmp_path, *words, said_on="stdout") as (process, address):
        operator = Operator(address)
        operator.does("/panel/name", "G1")
        operator.does("/panel/start")
        while not operator.sees("measuring").get("run", {}).get("doing"):
            pass
        operator.does("/run/live/stop")
        shown = operator.sees("verdict")
        assert (shown["verdict"]["word"], shown["left"]) == ("STOPPED", ["G1", "G2"])
        assert "stopped by the page" in shown["verdict"]["why"]
        operator.does("/panel/name", "G1")
        operator.does("/panel/start")
        shown = operator.sees("verdict")
        assert (shown["verdict"]["word"], shown["left"]) == ("DONE", ["G2"])
        assert shown["verdict"]["run"] in {each.name for each in (tmp_path / "runs").iterdir()}
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        assert process.returncode == 0
    assert said.startswith("G1: turntable: complete, runs/")
