"""The pytest plugin: simulated and served benches, faults and protocol tests for procedures and drivers.

It comes with the package and does nothing until a test asks for one of its fixtures; nothing of the package is imported
before that.

Fixtures: `simulated_bench` (an open bench on virtual time), `simulated_world` (the physics behind it), `fault` (what
goes wrong with it), `open_simulated_bench` (as many benches as a test wants, left when it wants), `served_bench` (the
bench on real wires), `expected_exchange` (protocol tests of drivers).

The mark `vcfbench` says which bench, for the test, class or module that carries it; the ini options ``vcfbench_bench``,
``vcfbench_parameters``, ``vcfbench_errors``, ``vcfbench_seed`` and ``vcfbench_overrides`` say it for all::

    @pytest.mark.vcfbench(seed=3, parameters="ideal", overrides={"site": {"latitude_deg": 0.0}})
    def test_scale_factor(simulated_bench): ...
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench import testing

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench
    from vcfbench.sim.world import World
    from vcfbench.station.description import BenchDescription
    from vcfbench.testing.benches import ServedLab, SimulatedLab

_MARK = (
    "vcfbench(bench=None, seed=None, parameters=None, errors=None, overrides=None, faults=None, speed=None): "
    "which simulated bench the fixtures of vcfbench open"
)
_SETTINGS = ("bench", "seed", "parameters", "errors", "overrides", "faults", "speed")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the ini options."""
    parser.addini("vcfbench_bench", "bench file, from the root directory, or the name of an embedded bench")
    parser.addini("vcfbench_parameters", "parameters of the simulated gyroscope: paper or ideal")
    parser.addini("vcfbench_errors", "errors of the simulated instruments: none or drawn")
    parser.addini("vcfbench_seed", "seed of the simulated benches")
    parser.addini("vcfbench_overrides", "single physical parameters, one a line, as in TOML", type="linelist")


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark."""
    config.addinivalue_line("markers", _MARK)


@pytest.fixture
def _vcfbench_lab(request: pytest.FixtureRequest) -> Iterator[SimulatedLab]:
    """Open the bench that the mark and the ini options ask for; faults are ended before it is left."""
    with ExitStack() as stack:
        with _mistakes_reported():
            asked = _asked(request)
            opened = testing.open_simulated(_described(request, asked), seed=asked["seed"], speed=asked["speed"])
            lab = stack.enter_context(opened)
            if asked["faults"] is not None:
                lab.play(_script(request, asked["faults"]))
        try:
            yield lab
        finally:
            lab.faults.clear()


@pytest.fixture
def simulated_bench(_vcfbench_lab: SimulatedLab) -> Bench:
    """Return an open simulated bench on virtual time; it is left through its safety stack."""
    return _vcfbench_lab.bench


@pytest.fixture
def simulated_world(_vcfbench_lab: SimulatedLab) -> World:
    """Return the physics behind `simulated_bench`: the true values, without errors of instruments."""
    return _vcfbench_lab.world


@pytest.fixture
def fault(_vcfbench_lab: SimulatedLab) -> Callable[..., None]:
    """Return a function that lets faults happen on `simulated_bench`: the kinds are in `simrack.faults`.

    ``fault("multimeter", "overload")`` happens now, ``fault("rate_table", "interlock", at_s=20.0)`` at a bench time,
    ``duration_s=`` says for how long.
    """
    return _vcfbench_lab.fault


@pytest.fixture
def open_simulated_bench(request: pytest.FixtureRequest) -> Callable[..., AbstractContextManager[SimulatedLab]]:
    """Return a function that opens benches as the mark and the ini options ask, but for the call's own arguments.

    ``with open_simulated_bench(seed=4) as lab:`` has `lab.bench`, `lab.world` and `lab.fault`. Faults go on while it is
    left, so that NotSafe can be expected.
    """

    def open_one(**changes: Any) -> AbstractContextManager[SimulatedLab]:
        with _mistakes_reported():
            asked = {**_asked(request), **changes}
            return testing.open_simulated(_described(request, asked), seed=asked["seed"], speed=asked["speed"])

    return open_one


@pytest.fixture
def served_bench(request: pytest.FixtureRequest) -> Iterator[ServedLab]:
    """Serve the bench on sockets of this computer; it has ready resource strings for any program."""
    with ExitStack() as stack:
        with _mistakes_reported():
            asked = _asked(request)
            faults = None if asked["faults"] is None else _script(request, asked["faults"])
            described = _described(request, asked)
            served = testing.serve_simulated(described, seed=asked["seed"], speed=asked["speed"], faults=faults)
            lab = stack.enter_context(served)
        yield lab


@pytest.fixture
def expected_exchange() -> Callable[..., AbstractContextManager[Any]]:
    """Return :func:`vcfbench.testing.expected_exchange`, for protocol tests of drivers."""
    return testing.expected_exchange


@contextmanager
def _mistakes_reported() -> Iterator[None]:
    """Raise a mistake in a test's settings in one sentence; the place in this plugin that saw it helps nobody."""
    from vcfbench.errors import ConfigError  # noqa: PLC0415  # nothing of the package before it is needed

    try:
        yield
    except (ConfigError, ValueError, FileNotFoundError) as error:
        pytest.fail(f"vcfbench: {error}", pytrace=False)


def _asked(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the settings: of the nearest mark that has them, else the ini options'."""
    config, asked = request.config, dict[str, Any].fromkeys(_SETTINGS)
    for name in ("bench", "parameters", "errors", "seed"):
        asked[name] = config.getini(f"vcfbench_{name}") or None
    asked["overrides"] = "\n".join(config.getini("vcfbench_overrides")) or None
    for mark in reversed(list(request.node.iter_markers("vcfbench"))):
        if mark.args or not set(mark.kwargs) <= set(_SETTINGS):
            raise ValueError(f"the mark is {_MARK}")
        asked.update(mark.kwargs)
    try:
        asked["seed"] = None if asked["seed"] is None else int(asked["seed"])
    except ValueError:
        raise ValueError(f"seed: expected a whole number, got {asked['seed']!r}") from None
    return asked


def _described(request: pytest.FixtureRequest, asked: dict[str, Any]) -> BenchDescription:
    bench = asked["bench"]
    if isinstance(bench, str) and (found := request.config.rootpath / bench).is_file():
        bench = found
    return testing.simulated(
        bench, parameters=asked["parameters"], errors=asked["errors"], overrides=asked["overrides"]
    )


def _script(request: pytest.FixtureRequest, faults: Any) -> Any:
    """Return a fault script: TOML text as it is, a path from the root directory."""
    return faults if isinstance(faults, str) and "\n" in faults else request.config.rootpath / faults
