"""`vcfbench run --page` and `vcfbench page` as commands: where they can be looked at, and how they end."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few

from tests import warm
from vcfbench.errors import ConfigError
from vcfbench.page.server import LivePage

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytest.importorskip("uvicorn", reason="pip install 'vcfbench[page]'")


@contextmanager
def started(folder: Path, *words: str, said_on: str = "stderr") -> Iterator[tuple[Any, str]]:
    """Start a command that shows a page; yield it and the address that it says."""
    with warm.running(["vcfbench", *words], folder, errors=True) as process:
        line = getattr(process, said_on).readline()
        assert line.startswith("page: http://127.0.0.1:"), line
        yield process, line.split()[1]


def fetched(address: str, path: str) -> str:
    root = address.split("/run/", maxsplit=1)[0].rstrip("/")
    with urllib.request.urlopen(f"{root}{path}", timeout=20) as answer:  # noqa: S310  # our own
        return str(answer.read(4000), "utf-8")


def stop(address: str, token: str) -> int:
    request = urllib.request.Request(  # noqa: S310  # our own
        f"{address.split('#', maxsplit=1)[0]}/stop", method="POST", headers={"X-Vcfbench-Token": token}
    )
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:  # noqa: S310  # our own
            return int(answer.status)
    except urllib.error.HTTPError as error:
        with error:
            return error.code


def test_stop_from_the_page_ends_as_from_the_keyboard(tmp_path: Path) -> None:
    with started(tmp_path, "run", "virtual-coriolis", "--speed", "20", "--page", "--quiet") as (process, address):
        assert "<title>vcfbench</title>" in fetched(address, "/run/live")
        assert '"live":true' in fetched(address, "/station")
        while json.loads(fetched(address, "/run/live/readings?most=2"))["count"] == 0:
            assert process.poll() is None
        assert stop(address, "wrong") == 403
        assert process.poll() is None
        assert stop(address, address.split("#")[1]) == 200
        _, words = process.communicate(timeout=60)
        assert process.returncode == 4
    assert "stopped by the page" in words
    assert "the bench was made safe" in words
    (journal,) = tmp_path.glob("runs/*/journal.jsonl")
    footer = json.loads(journal.read_text("utf-8").splitlines()[-1])
    assert footer["status"] == "aborted"
    assert footer["safe"]
    assert all(each["safe"] for each in footer["safe"])


@pytest.mark.exhaustive
def test_a_page_that_nobody_looks_at_changes_nothing(tmp_path: Path) -> None:
    quiet = ["vcfbench", "run", "turntable", "--bench", "ideal", "--json", "--quiet"]
    without, with_page = warm.run(quiet, tmp_path), warm.run([*quiet, "--page"], tmp_path)
    first, second = json.loads(without.stdout), json.loads(with_page.stdout)
    assert {**first, "run": None} == {**second, "run": None}
    assert with_page.stderr.startswith("page: http://127.0.0.1:")


@pytest.mark.exhaustive
def test_browsers_that_take_nothing_hold_up_nobody(tmp_path: Path) -> None:
    """Closed laptops, and readers that stand still: the run goes on, and the command ends."""
    with started(tmp_path, "run", "turntable", "--bench", "ideal", "--speed", "100", "--page", "--quiet") as (
        process,
        address,
    ):
        port = int(address.split(":")[2].split("/")[0])
        still = [socket.create_connection(("127.0.0.1", port)) for _ in range(8)]
        for number, each in enumerate(still):
            each.sendall(f"GET /run/live/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            if number % 2:
                each.close()
        process.communicate(timeout=60)
        for each in still:
            each.close()
        assert process.returncode == 0
    (journal,) = tmp_path.glob("runs/*/journal.jsonl")
    assert "observers_lost" not in json.loads(journal.read_text("utf-8").splitlines()[-1])


def test_a_port_that_is_taken_is_said_before_anything_begins(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for words in (["run", "turntable", "--page", "--port", port], ["page", "--port", port]):
            done = warm.run(["vcfbench", *words], tmp_path)
            assert done.returncode == 2
            assert f"--port {port}: the page cannot use this port" in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to another process")
def test_the_page_of_a_station_ends_with_ctrl_c(tmp_path: Path) -> None:
    with started(tmp_path, "page", "--port", "0", said_on="stdout") as (process, address):
        assert fetched(address, "/station") == '{"runs":[],"older":0,"devices":[],"live":false}'
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30) == ("", "")
        assert process.returncode == 0


@pytest.mark.parametrize(
    ("library", "words"),
    few([("starlette", ["page"]), ("uvicorn", ["run", "turntable", "--page", "--quiet"])], every=2),
)
def test_without_its_extra_it_says_what_to_install(library: str, words: list[str], tmp_path: Path) -> None:
    """In a process of its own: nothing of the page may be imported before it is seen that it can be."""
    code = f"import sys; sys.modules[{library!r}] = None; from vcfbench.cli.main import main; main()"
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.stderr.startswith(f"vcfbench: the page in a browser needs {library}, which is not installed")
    assert 'pip install "starlette>=' in done.stderr
    assert (done.stdout, done.returncode) == ("", ConfigError.exit_code)


def test_it_listens_on_this_machine_alone(tmp_path: Path) -> None:
    page = LivePage(tmp_path, tmp_path, 0)
    with page:
        assert page._socket.getsockname()[0] == "127.0.0.1"
        first = page.address.split("#")[1]
    with LivePage(tmp_path, tmp_path, 0) as other:
        assert other.address.split("#")[1] != first
    assert len(first) >= 16
