"""An interrupt at a prompt or in a notebook ends nothing, and brings the table to rest all the same."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

TURN = """
import time, vcfbench
bench = vcfbench.open_bench("lab")
table = bench.rate_table
table.enable()
table.set_rate(20.0, 100.0)
bench.clock.sleep_until(bench.clock.now() + 2.0)
print("turns at", round(table.rate_deg_s(), 2))
"""
LOOK = """
bench.clock.sleep_until(bench.clock.now() + 2.0)
print("turns at", abs(round(table.rate_deg_s(), 1)))
table.set_rate(5.0, 100.0)
bench.clock.sleep_until(bench.clock.now() + 2.0)
print("turns at", round(table.rate_deg_s(), 2))
bench.close()
"""


@pytest.mark.exhaustive
def test_at_pythons_prompt() -> None:
    interrupted = [sys.executable, "-i", "-c", f"{TURN}\nraise KeyboardInterrupt"]
    done = subprocess.run(  # noqa: S603
        interrupted, input=LOOK, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split("\n")[:3] == ["turns at 20.0", "turns at 0.0", "turns at 5.0"]
    assert "interrupted while bench lab is open; its table was told to stop" in done.stderr


IN_A_THREAD = """
import threading, vcfbench

class Turns:
    def handle(self, event):
        if isinstance(event, vcfbench.ReadingTaken):
            measures.set()

measures = threading.Event()
settings = {"rates_deg_s": [10, 0, -10], "samples": 20}
run = vcfbench.start("turntable", speed=20, settings=settings, observers=[Turns()], runs=None)
measures.wait(60)
raise KeyboardInterrupt
"""


def test_a_run_in_a_thread_goes_on_at_pythons_prompt() -> None:
    interrupted = [sys.executable, "-i", "-c", IN_A_THREAD]
    done = subprocess.run(  # noqa: S603
        interrupted, input="print(run.result().status)\n", capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "complete\n"
    assert "was told to stop" not in done.stderr


KERNEL = """
import sys, time
from jupyter_client.manager import start_new_kernel
manager, client = start_new_kernel(kernel_name="python3")
def said(code, interrupt=False):
    client.execute(code)
    while True:
        message = client.get_iopub_msg(timeout=60)
        kind, content = message["msg_type"], message["content"]
        if kind == "stream":
            print(content["text"], end="")
            if interrupt and "turns at" in content["text"]:
                manager.interrupt_kernel()
        elif kind == "status" and content["execution_state"] == "idle":
            return
said(sys.argv[1] + "\\ntime.sleep(30)", interrupt=True)
said(sys.argv[2])
client.stop_channels()
manager.shutdown_kernel()
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(find_spec("ipykernel") is None, reason="pip install '.[dev]'")
def test_by_the_stop_button_of_a_notebook(tmp_path: Path) -> None:
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", KERNEL, TURN, LOOK],
        cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    shown = [line for line in done.stdout.split("\n") if line.startswith("turns")]
    assert shown == ["turns at 20.0", "turns at 0.0", "turns at 5.0"]
    assert "its table was told to stop" in done.stdout
