"""One owner an instrument: whoever asks, by whatever name, is refused while a run has it."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.faults.benches import SPEED, bench_text, serving
from tests.faults.forks import fork_host
from tests.faults.matrix import Station

if TYPE_CHECKING:
    from pathlib import Path

OTHER_USER = 65534

pytestmark = [
    pytest.mark.slow,
    pytest.mark.exhaustive,  # it waits; tests/safety/test_lock.py refuses within a millisecond
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals"),
]


def second_run(folder: Path, bench: str, *, state: Path | None = None, user: int | None = None) -> tuple[int, str]:
    """Run in another process; return its exit code and what it said."""
    folder.mkdir()
    (folder / "bench.toml").write_text(bench)
    environment = {**os.environ, **({} if state is None else {"XDG_STATE_HOME": str(state)})}
    if user is not None:
        os.chown(folder, user, user)
        environment |= {"HOME": str(folder)}
    words = ["run", "turntable", "--quiet", "--bench", str(folder / "bench.toml"), "--runs", str(folder / "runs")]
    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-c", "from vcfbench.cli.main import main; main()", *words],
        capture_output=True,
        text=True,
        env=environment,
        user=user,
        group=user,
        check=False,
        timeout=120.0,
    )
    return done.returncode, done.stderr


def test_a_second_run_is_refused_by_whatever_name(tmp_path: Path) -> None:
    name = f"owners-{tmp_path.parent.name}"[:50]
    text = bench_text("acl", name=name).replace("samples = 2", "samples = 900")
    text = text.replace("sample_interval_s = 0.1", "sample_interval_s = 8")  # a wall second: the machine may be busy
    with serving(tmp_path, text, speed=SPEED["acl"]) as served, fork_host() as host:
        station = Station(served, host, tmp_path, "acl")
        bench = served.bench_file(served.resources("tcp"))
        run = station.brought_to("rails on", "turntable")
        renamed = bench.replace(f'name = "{name}"', f'name = "{name}-too"')
        tries = {
            "the same name": second_run(tmp_path / "a", bench),
            "another name": second_run(tmp_path / "b", renamed),
            "another state directory": second_run(tmp_path / "c", bench, state=tmp_path / "state"),
            "both": second_run(tmp_path / "d", renamed, state=tmp_path / "other state"),
        }
        live = station.come("rails on")
        run.signal(15)
        assert run.wait() == 4, run.stderr
    assert live
    assert {what: code for what, (code, _) in tries.items()} == dict.fromkeys(tries, 3)
    assert all("in use" in words for _, words in tries.values()), tries
