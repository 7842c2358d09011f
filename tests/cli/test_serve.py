"""Options and answers of ``vcfbench sim serve`` and ``sim ctl``; what is served is tested with the server."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack_tests.serve.lamp import served_lamp
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.cli.serve import _offers
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from click.testing import Result


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["sim", *arguments])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--ports 65534", "ports: too few up to 65535"),
        ("--ports 99999", "expected a port number"),
        ("--ports ²", "expected a port number"),
        ("--port-mapper 99999999", "less than or equal to 65535"),
        ("--speed 1e300", "a speed is from 1e-06 to 1e+06"),
        ("--speed nan", "expected a number of at least"),
        ("--faults /dev/zero", "expected a fault script, this is a device"),
        ("--faults /", "expected a fault script, this is a directory"),
        ("--offer power", "expected ROLE:KIND,... as in rate_source:hislip,power:vxi11"),
        ("--offer power:", "expected ROLE:KIND"),
        ("--offer power:vxi11,:pty", "expected ROLE:KIND"),
        ("--offer power:fax", "not on 'fax'"),
        ("--offer lamp:tcp", "no 'lamp'"),
        ("--seed 9223372036854775808", "9223372036854775807"),
    ],
)
def test_what_cannot_be_served_is_one_sentence_of_usage(arguments: str, words: str) -> None:
    done = call("serve", *arguments.split())
    assert done.exit_code == 2
    assert words in done.output
    assert "Traceback" not in done.output


def test_an_offer_may_name_several_roles() -> None:
    assert _offers(["power:vxi11,hislip,multimeter:vxi11", "power:pty"]) == {
        "power": {"vxi11", "hislip", "pty"},
        "multimeter": {"vxi11"},
    }
    with pytest.raises(ConfigError):
        _offers(["vxi11,power:pty"])


def test_a_fault_is_told_with_what_was_not_asked_for() -> None:
    with served_lamp() as served:
        done = call("ctl", "--port", str(served.server.control.port), "fault", "lamp", "late")
        assert done.exit_code == 0
        assert float(done.stdout) >= 0.0  # for scripts: the bench time
        assert "lamp: late, delay_s 1.0, from " in done.stderr
        assert done.stderr.endswith("s of bench time until it is cleared\n")


@pytest.mark.parametrize("argument", ["id=3", "do=stop"])
def test_what_names_a_request_is_no_argument_of_one(argument: str) -> None:
    done = call("ctl", "status", argument)
    assert isinstance(done.exception, ConfigError | SystemExit)
    assert "is not an argument of a command" in done.output
