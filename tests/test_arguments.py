"""Arguments of every public function: a wrong type is a ConfigError with the parameter's name, and nothing begins."""

from __future__ import annotations

import inspect
import pickle
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vcfbench
from vcfbench.arguments import _SAID_THERE
from vcfbench.errors import ConfigError

FUNCTIONS = {name: each for name in vcfbench.__all__ if inspect.isfunction(each := getattr(vcfbench, name))}
LOOKED_AT_BY_NUMPY = "characterise"
PARAMETERS = [
    (name, key)
    for name, each in FUNCTIONS.items()
    for key in inspect.signature(each).parameters
    if name != LOOKED_AT_BY_NUMPY and key not in _SAID_THERE.get(name, ())
]


class Odd:
    """A value that no parameter can mean."""


def called(name: str, key: str, value: Any) -> Any:
    function = FUNCTIONS[name]
    parameters = inspect.signature(function).parameters
    needed = {each.name: None for each in parameters.values() if each.default is each.empty}
    if parameters[key].kind is inspect.Parameter.VAR_POSITIONAL:
        return function(value)
    for other in needed:
        if other != key and parameters[other].kind is not inspect.Parameter.VAR_POSITIONAL:
            needed[other] = value
    return function(**{each: given for each, given in needed.items() if given is not None}, **{key: value})


@pytest.mark.parametrize(("name", "key"), PARAMETERS)
def test_a_wrong_type_is_refused_with_the_name_of_a_parameter(
    name: str, key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as refused:
        called(name, key, Odd())
    assert any(str(refused.value).startswith(f"{each}: ") for each in inspect.signature(FUNCTIONS[name]).parameters)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: vcfbench.load_run(None), "name_or_path: expected a text or a path, got nothing"),  # type: ignore[arg-type]
        (lambda: vcfbench.run("turntable", runs=3), "runs: expected a text or a path or None, got 3"),  # type: ignore[arg-type]
        (lambda: vcfbench.dry_run("turntable", seed=True), "seed: expected a whole number or None, got true"),
        (lambda: vcfbench.run("turntable", observers=print), "observers: expected a list, each Observer, got"),  # type: ignore[arg-type]
        (lambda: vcfbench.analyze_record(np.zeros(3)), "file: expected a path or a text, got ndarray"),  # type: ignore[arg-type]
    ],
)
def test_a_wrong_type_is_told_with_what_is_expected(call: Any, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        call()
    assert str(refused.value).startswith(said)


USUAL = {"output": "P6V", "voltage_v": 0, "wires": 2, "range_ohm": 100}
"""Arguments for which 1 will not do."""


@pytest.mark.parametrize("odd", ["3", None, True, [1.0], Odd()])
def test_no_instrument_takes_what_is_no_number(odd: Any) -> None:
    tried = 0
    with vcfbench.open_bench("lab", seed=1) as bench:
        for instrument in bench.instruments.values():
            names = [name for name in dir(instrument) if name.startswith(("configure", "set", "start", "stop"))]
            for act in (getattr(instrument, name) for name in names):
                parameters = inspect.signature(act).parameters
                for name in [key for key, each in parameters.items() if "float" in str(each)]:
                    arguments = {key: USUAL.get(key, 1) for key in parameters}
                    with pytest.raises(ConfigError, match="expected a number, got"):
                        act(**{**arguments, name: odd})
                    tried += 1
    assert tried > 20


def test_a_day_is_a_day_however_it_is_given(tmp_path: Path) -> None:
    for since in ("2026-01-15", date(2026, 1, 15), datetime(2026, 1, 15, tzinfo=UTC)):
        assert vcfbench.list_runs(tmp_path, since=since) == ()


def test_a_public_function_goes_to_another_process() -> None:
    assert pickle.loads(pickle.dumps(vcfbench.analyze)) is vcfbench.analyze  # noqa: S301
