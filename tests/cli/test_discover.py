from __future__ import annotations

import json
import socket

from typer.testing import CliRunner

from vcfbench.cli.main import app


def test_what_a_person_reads() -> None:
    done = CliRunner().invoke(app, ["bench", "discover", "--library", "@vcfbench"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "GPIB0::22::INSTR: 34401A, HEWLETT-PACKARD,34401A,0,11-5-2\n" in done.stdout
    assert '[multimeter]  # HEWLETT-PACKARD,34401A,0,11-5-2\nmodel = "34401A"\n' in done.stdout


def test_what_a_program_reads() -> None:
    done = CliRunner().invoke(app, ["bench", "discover", "--library", "paper@vcfbench", "--json"])
    answer = json.loads(done.stdout)
    assert answer["library"] == "paper@vcfbench"
    assert {each["model"] for each in answer["resources"]} == {"E3631A", "33220A", "34401A", "DSO7104B"}
    assert "[power]" in answer["stanza"]
    assert answer["serial_ports"] == answer["tried"] == []


def test_named_resource_without_answer_is_failure() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closing:
        name = f"TCPIP::127.0.0.1::{closing.getsockname()[1]}::SOCKET"
    done = CliRunner().invoke(app, ["bench", "discover", "--library", "@vcfbench", "--try", name])
    assert done.exit_code == 3
    assert f"{name}: no instrument answers there" in done.stdout
    assert done.stderr == f"vcfbench: no answer from {name}\n"
