from __future__ import annotations

import copy
import subprocess
import sys
import tomllib
from datetime import date
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect, structs

from tests.characters import CHARACTERS
from vcfbench.drivers.streams.description import Stream
from vcfbench.errors import ConfigError
from vcfbench.models import MODELS
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.keys import settable_keys
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.station.description import BenchDescription, Knowledge, SerialSettings, Served, Simulation
from vcfbench.station.file import EMBEDDED, embedded_text, template
from vcfbench.strict import one_of

EXAMPLES = Path(__file__).parents[2] / "examples"
METERS = " or ".join(f"'{row.name}'" for row in MODELS if "multimeter" in row.roles)


def to_toml(table: dict[str, Any], prefix: str = "") -> str:
    """Write a nested dict as TOML: enough of it for these tests."""
    lines = [f"{key} = {value_to_toml(value)}" for key, value in table.items() if not isinstance(value, dict)]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += [f"[{prefix}{key}]", to_toml(value, f"{prefix}{key}.")]
    return "\n".join(lines)


def value_to_toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(map(value_to_toml, value))}]"
    return str(value) if isinstance(value, date) else repr(value)


def full_template() -> dict[str, Any]:
    """Every key of the template."""
    return tomllib.loads("\n".join(uncommented(line) for line in template().splitlines()))


def full_file() -> dict[str, Any]:
    """A bench file with every key written out that can stand beside the others."""
    raw = full_template()
    del raw["served"]
    del raw["multimeter"]["calibration"]  # an array of tables: it has its own tests, as the file in its place has
    del raw["multimeter"]["calibration_dcc"]
    raw["simulation"]["errors"]["power"] = "none"
    return raw


def uncommented(line: str) -> str:
    bare = line.removeprefix("# ")
    is_setting = bare.startswith("[") or bare.partition(" = ")[0].replace("_", "").isalnum()
    return bare if is_setting and (" = " in bare or bare.startswith("[")) else line


def leaves(table: dict[str, Any], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found: list[tuple[str, ...]] = []
    for key, value in table.items():
        found += leaves(value, (*path, key)) if isinstance(value, dict) else [(*path, key)]
    return found


def changed(raw: dict[str, Any], path: tuple[str, ...], value: object) -> dict[str, Any]:
    raw = copy.deepcopy(raw)
    parent = raw
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    return raw


def without(raw: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    raw = copy.deepcopy(raw)
    parent = raw
    for key in path[:-1]:
        parent = parent[key]
    del parent[path[-1]]
    return raw


def refusal(raw: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_bench(to_toml(raw), "lab.toml")
    assert caught.value.exit_code == 2
    return str(caught.value)


FULL = full_file()
LEAVES = leaves(FULL)
KEYS = {key for path in LEAVES for key in path} | set(FULL) | {"calibration", "calibration_dcc"}
KEYS |= {*full_template()["multimeter"]["calibration"][0]}
VC = ("virtual-coriolis",)
REQUIRED = [
    *((role, key) for role in ("power", "rate_source", "multimeter", "oscilloscope") for key in ("model", "resource")),
    *(("rate_table", key) for key in ("dialect", "resource")),
    *(("limits", key) for key in FULL["limits"]),
    ("site", "latitude_deg"),
    ("name",),
]


def test_the_template_names_every_key_once_and_shows_the_defaults() -> None:
    written = parse_bench(to_toml(FULL), "full")
    apart = {"served", *full_template()["served"]}
    assert apart == {"served", *keys_of(Served)}
    settable = {key.path.rpartition(".")[2] for key in settable_keys(VirtualCoriolisSettings)}
    apart |= {"stream", *keys_of(Stream)}  # docs/howto/stream.md has those
    assert keys_of(BenchDescription) | settable - {"override"} - apart <= KEYS | {"override"} | apart
    bare = parse_bench(template(), "template")
    assert written.procedure == bare.procedure
    assert written.wiring == bare.wiring
    assert written.visa_library == bare.visa_library
    assert written.power.serial == SerialSettings()
    assert structs.replace(written.rate_table, baud_rate=None, steps_per_deg=None) == bare.rate_table
    assert written.power.timeout_s == bare.power.timeout_s
    assert structs.replace(written.simulation or Simulation(), errors=Simulation().errors) == Simulation()


def keys_of(node: object) -> set[str]:
    """Every key that a bench file may have."""
    found: set[str] = set()
    pending: list[inspect.Type] = [inspect.type_info(node)]
    while pending:
        kind = pending.pop()
        if isinstance(kind, inspect.UnionType):
            pending += kind.types
        elif isinstance(kind, inspect.StructType):
            found |= {field.encode_name for field in kind.fields}
            pending += [field.type for field in kind.fields]
    return found


@pytest.mark.parametrize(
    ("control", "expected"),
    [
        ("20220", "with host and port, as in 127.0.0.1:20220"),
        ("127.0.0.1:99999", "a port from 1 to 65535"),
        ("::1:20220", "with host and port"),
    ],
)
def test_an_address_is_a_host_and_a_port(control: str, expected: str) -> None:
    served = {key: value for key, value in FULL.items() if key != "simulation"} | {"served": {"control": control}}
    assert f"served.control: expected {expected}" in refusal(served).replace("expected a text with", "expected with")


def test_a_bench_is_simulated_here_or_elsewhere() -> None:
    assert "served: expected no [served] beside [simulation]" in refusal(FULL | {"served": {"control": "a:1"}})


@pytest.mark.parametrize(
    ("control", "address"), [("127.0.0.1:20220", ("127.0.0.1", 20220)), ("[::1]:20220", ("::1", 20220))]
)
def test_an_address_is_taken_apart(control: str, address: tuple[str, int]) -> None:
    assert Served(control=control).address() == address


def test_the_examples_are_the_embedded_files() -> None:
    assert (EXAMPLES / "paper-bench.toml").read_text("utf-8") == template()
    assert (EXAMPLES / "ideal-bench.toml").read_text("utf-8") == embedded_text("ideal")


def test_the_embedded_benches_load_and_none_is_the_paper_bench() -> None:
    assert load_bench(None).name == "paper"
    assert [load_bench(name).name for name in EMBEDDED] == list(EMBEDDED)


def test_a_directory_does_not_hide_an_embedded_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lab").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_bench("lab").name == "lab"


@pytest.mark.parametrize("name", EMBEDDED)
def test_the_embedded_benches_agree_with_themselves(name: str) -> None:
    """Which load_bench takes for granted, so that nothing heavy is imported to see it."""
    assert parse_bench(embedded_text(name), name) == load_bench(name)
    for procedure in PROCEDURES.values():
        asked = asked_in_python({"k_vc": "150"} if procedure.name in {"online", "self-calibration"} else {})
        settings_of(procedure, load_bench(name), asked)


def test_a_bench_is_loaded_without_the_simulation() -> None:
    code = (
        "import sys; from vcfbench.procedures.bench_file import load_bench; load_bench(); print('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout == "False\n"
    assert load_bench(None).simulated
    assert not parse_bench(template(), "template").simulated
    assert resources.files("vcfbench.station").joinpath("paper.toml").is_file()


def test_the_seventeen_rates_are_the_papers() -> None:
    rates = load_bench(None).procedure.rates_deg_s
    assert len(rates) == 17
    assert sum(rates) == 0
    assert sum(rate * rate for rate in rates) == 106_060


def test_bench_file_may_begin_with_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(template(), encoding="utf-8-sig")
    assert load_bench(path).name == "lab-1"


@given(st.sampled_from(LEAVES), st.text("abcdefghijklmnopqrstuvwxyz_0123456789", min_size=1, max_size=12))
def test_a_mistyped_key_is_one_line_with_its_path(path: tuple[str, ...], tail: str) -> None:
    if path[0] == "simulation" and "override" in path:
        return
    mistyped = (*path[:-1], f"{path[-1]}_{tail}")
    said = refusal(changed(FULL, mistyped, 1))
    assert said.startswith(f"lab.toml: {'.'.join(mistyped)}: expected ")
    assert said.endswith(", got an unknown key")
    assert "\n" not in said


def test_a_close_key_is_suggested() -> None:
    said = refusal(changed(FULL, ("limits", "max_rate_degs"), 1))
    assert said == ("lab.toml: limits.max_rate_degs: expected a known key ('max_rate_deg_s'?), got an unknown key")


def _leaf(path: tuple[str, ...]) -> object:
    table: Any = FULL
    for key in path:
        table = table[key]
    return table


@given(st.sampled_from(LEAVES), st.sampled_from([True, [[]], [{}], 1.5j]))
def test_a_wrong_type_is_one_line_with_its_path(path: tuple[str, ...], value: object) -> None:
    if value is True and isinstance(_leaf(path), bool):
        return  # that is what it should be
    if value == 1.5j and path[-1] in {"calibrated", "calibration_due"}:
        return  # so is a date there
    value = "1979-05-27" if value == 1.5j else value
    raw = changed(FULL, path, value)
    text = to_toml(raw).replace('"1979-05-27"', "1979-05-27")
    with pytest.raises(ConfigError) as caught:
        parse_bench(text, "lab.toml")
    said = str(caught.value)
    assert said.startswith(f"lab.toml: {'.'.join(path)}")
    assert ": expected " in said
    assert ", got " in said
    assert "\n" not in said


@given(st.sampled_from([path for path in LEAVES if not isinstance(FULL[path[0]], str)]))
def test_a_table_in_place_of_a_value_is_refused(path: tuple[str, ...]) -> None:
    if path[:2] == ("simulation", "errors"):
        return  # a table of single errors is welcome there
    said = refusal(changed(FULL, path, {"x": 1}))
    assert said.startswith(f"lab.toml: {'.'.join(path)}: expected ")
    assert said.endswith(", got a table")


def numeric_leaves() -> list[tuple[str, ...]]:
    found = []
    for path in LEAVES:
        value: Any = FULL
        for key in path:
            value = value[key]
        if isinstance(value, int | float):
            found.append(path)
    return found


@given(st.sampled_from(numeric_leaves()), st.sampled_from([1e30, -1e30, float("inf"), float("nan"), 10**40, 10**400]))
def test_number_out_of_range_is_one_line_with_path(path: tuple[str, ...], value: float) -> None:
    said = refusal(changed(FULL, path, value))
    assert said.startswith(f"lab.toml: {'.'.join(path)}: expected ")
    assert ", got " in said
    assert "\n" not in said


@pytest.mark.parametrize("path", REQUIRED, ids=".".join)
def test_a_missing_key_is_one_line_with_its_path(path: tuple[str, ...]) -> None:
    said = refusal(without(FULL, path))
    assert said.startswith(f"lab.toml: {'.'.join(path)}: expected ")
    assert said.endswith(", got nothing")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("limits", "max_rate_deg_s"), "fast", "expected a number at least 0.001 and at most 5000, got 'fast'"),
        (("limits", "max_v_vc_v"), 11, "expected a number at least 0.001 and at most 10, got 11"),
        (
            ("multimeter", "model"),
            "2010",
            f"expected {METERS}, or one that speaks the same words",
        ),
        (("site", "mains_hz"), 55, "expected 50 or 60, got 55"),
        (("site", "latitude_deg"), 91, "expected a number at least -90 and at most 90, got 91"),
        (("name",), "lab 1", "expected a text of letters, digits, '_', '-' and '.', got 'lab 1'"),
        (("power", "serial", "parity"), "mark", "expected 'even' or 'none' or 'odd', got 'mark'"),
        (("procedure", "drive", "amplitude_v"), [1], "expected a list of 2 numbers, got [1]"),
        (("procedure", "samples"), 2.5, "expected a whole number at least 2 and at most 1000000, got 2.5"),
        (("wiring", "oscilloscope", "channel_1"), "driv", "expected 'carrier' or 'drive' or"),
    ],
)
def test_what_was_expected_and_what_came(path: tuple[str, ...], value: object, said: str) -> None:
    assert refusal(changed(FULL, path, value)).startswith(f"lab.toml: {'.'.join(path)}: {said}")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("procedure", "rates_deg_s"), [0, 10, 301], "procedure.rates_deg_s[2]: expected a rate of at most 300 deg/s"),
        (("procedure", "rates_deg_s"), [5, 5, 5], "procedure.rates_deg_s: expected at least three different rates"),
        (
            ("procedure", *VC, "match_rate_deg_s"),
            0,
            "procedure.virtual-coriolis.match_rate_deg_s: expected",
        ),
        (("procedure", "acceleration_deg_s2"), 201, "procedure.acceleration_deg_s2: expected at most 200"),
        (("procedure", "k_vc_guess_deg_s_per_v"), -19, "procedure.k_vc_guess_deg_s_per_v: expected at least 20"),
        (("limits", "min_rail_v"), 11, "limits.min_rail_v: expected less than limits.max_rail_v = 10.5 V, got 11"),
        (("procedure", "positive_rail_v"), 12, "procedure.positive_rail_v: expected a rail of 9.5 to 10.5 V"),
        (("procedure", "negative_rail_v"), -9, "procedure.negative_rail_v: expected a rail of 9.5 to 10.5 V"),
        (("procedure", "rail_current_limit_a"), 0.3, "procedure.rail_current_limit_a: expected at most 0.2 A"),
        (("wiring", "rails", "positive"), "N25V", "wiring.rails.positive: expected 'P6V' or 'P25V'"),
        (("wiring", "rails", "positive"), "P6V", "procedure.positive_rail_v: expected at most 6.18 V"),
        (("wiring", "rails", "negative"), "P25V", "wiring.rails.negative: expected 'N25V'"),
        (("wiring", "oscilloscope", "channel_1"), "sense", "wiring.oscilloscope: expected a channel on 'drive'"),
        (("procedure", "nplc"), 100, "procedure.sample_interval_s: expected at least 4 s"),
        (("procedure", "drive", "phase_deg"), [5, 5], "procedure.drive.phase_deg: expected a window [low, high]"),
        (("procedure", *VC, "match_rate_deg_s"), 0.05, "procedure.virtual-coriolis.match_rate_deg_s: expected"),
        (("procedure", "k_vc_guess_deg_s_per_v"), 10001, "procedure.k_vc_guess_deg_s_per_v: expected at most 10000"),
        (("limits", "min_rail_v"), 1e-7, "limits.min_rail_v: expected 0, or at least 1e-06 either sign, got 1e-07"),
        (("procedure", "rates_deg_s"), [1, 2, -1e-300], "procedure.rates_deg_s[2]: expected 0, or at least 1e-06"),
        (("multimeter", "resource"), "gpib0::5::instr", "multimeter.resource: expected a resource of its own"),
        (
            ("procedure", "drive", "frequency_hz"),
            [3.475, 3.503],
            "procedure.drive.frequency_hz: expected a window",
        ),
        (("procedure", "drive", "amplitude_v"), [50, 300], "procedure.drive.amplitude_v: expected a window up to 25 V"),
        (("procedure", "drive", "phase_deg"), [1.4, 1.75], "procedure.drive.phase_deg: expected a window of 2 degrees"),
        (("expected", "scale_factor_v_per_deg_s"), [-12.7, -12.4], "expected.scale_factor_v_per_deg_s: expected at mo"),
        (("expected", "bias_v"), [-50, -30], "expected.bias_v: expected at most 10.5 either way: the output ends at"),
        (("expected", "zero_drift_v"), 30, "expected.zero_drift_v: expected at most 10.5 either way"),
        (("acceptance", "bias_v"), [-42, 42], "acceptance.bias_v: expected at most 10.5 either way"),
        (("acceptance", "reading_noise_v"), [0, 14], "acceptance.reading_noise_v: expected at most 10.5 either way"),
    ],
)
def test_contradictions_between_keys_are_refused(path: tuple[str, ...], value: object, said: str) -> None:
    assert refusal(changed(FULL, path, value)).startswith(f"lab.toml: {said}")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = \n", "line 1"),
        ('name = "a"\nname = "b"\n', "line 2"),
        ("x = " + "[" * 5000, "nested too deeply"),
        ("x = " + "1" * 5000, "expected TOML"),
    ],
)
def test_malformed_toml_is_one_line(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(text, "lab.toml")
    assert str(caught.value).startswith("lab.toml: expected TOML: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.text(CHARACTERS))
def test_any_text_is_a_bench_or_one_line(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(text, "lab.toml")
    assert len(str(caught.value).splitlines()) == 1


@given(st.text("\n\r\x85\u2028\t .[]`$\"'\\ab", min_size=1))
def test_a_strange_unknown_key_stays_on_one_line(key: str) -> None:
    quoted = '"' + "".join(f"\\U{ord(char):08X}" for char in key) + '"'
    with pytest.raises(ConfigError) as caught:
        parse_bench(f"{template()}\n[site2]\n".replace("[site2]", f"[{quoted}]"), "lab.toml")
    assert len(str(caught.value).splitlines()) == 1


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        load_bench(tmp_path / "none.toml")
    with pytest.raises(ConfigError, match="expected a bench file, "):
        load_bench(tmp_path)
    with pytest.raises(ConfigError, match="expected a bench file, "):
        load_bench("a\0b")
    (tmp_path / "latin.toml").write_bytes(b'name = "caf\xe9"')
    with pytest.raises(ConfigError, match="expected UTF-8 text, got byte 0xe9"):
        load_bench(tmp_path / "latin.toml")


@pytest.mark.parametrize("path", [("name",), ("title",), ("power", "resource"), ("visa_library",)])
@pytest.mark.parametrize("tail", ["\\n", "\\u0000", "\\r", "\\u2028"])
def test_texts_stay_on_one_line(path: tuple[str, ...], tail: str) -> None:
    said = refusal(changed(FULL, path, f"a{tail}"))
    assert said.startswith(f"lab.toml: {'.'.join(path)}: expected a text")
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("procedure", "settle_s"), 0),
        (("procedure", "sample_interval_s"), 1e-300),
        (("procedure", "rate_tolerance_deg_s"), 1e-9),
        (("procedure", "k_vc_guess_deg_s_per_v"), 1e308),
        (("procedure", "drive", "frequency_hz"), [0.0, 3500.0]),
        (("procedure", "drive", "amplitude_v"), [0.1, 1e308]),
        (("limits", "max_v_vc_v"), 1e-300),
        (("power", "timeout_s"), 1e-300),
    ],
)
def test_numbers_that_no_station_can_mean_are_refused(path: tuple[str, ...], value: object) -> None:
    assert refusal(changed(FULL, path, value)).startswith(f"lab.toml: {'.'.join(path)}")


def test_a_denormal_number_is_refused_before_it_is_anything() -> None:
    said = refusal(changed(FULL, ("limits", "min_rail_v"), 1e-320))
    assert said.startswith("lab.toml: limits.min_rail_v: expected zero or a number of at least 2.2e-308")


SERVED = embedded_text("paper").split("[simulation]")[0] + '[served]\ncontrol = "{}"\n'


@pytest.mark.parametrize("address", ["127.0.0.1:20220", "localhost:1", "[::1]:65535", "127.8.0.1:5"])
def test_a_served_bench_is_on_this_host(address: str) -> None:
    assert parse_bench(SERVED.format(address), "lab.toml").served is not None


@pytest.mark.parametrize(
    "address", ["8.8.8.8:1", "example.org:20220", "[2001:db8::1]:20220", "0.0.0.0:20220", "127.1:80"]
)
def test_bench_file_cannot_name_another_host(address: str) -> None:
    with pytest.raises(ConfigError, match=r"served\.control: expected this host"):
        parse_bench(SERVED.format(address), "lab.toml")


def with_table(directory: Path, dialect: str) -> Path:
    text = to_toml({**FULL, "rate_table": {"dialect": dialect, "resource": "/dev/ttyUSB0"}})
    (directory / "lab.toml").write_text(text)
    return directory / "lab.toml"


def test_table_profile_is_read_with_bench_file(tmp_path: Path) -> None:
    path = with_table(tmp_path, "own.toml")
    with pytest.raises(ConfigError, match=r"own\.toml: expected a profile of a rate table, there is no such file"):
        load_bench(path)
    (tmp_path / "own.toml").write_text("title = 3")
    with pytest.raises(ConfigError, match=r"own\.toml: title: expected a text"):
        load_bench(path)


def test_zaber_is_told_its_microsteps(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rate_table\.steps_per_deg: expected the stage's microsteps per degree"):
        load_bench(with_table(tmp_path, "zaber"))


@pytest.mark.parametrize("value", ["1e308", "1e31"])
def test_physical_parameters_are_numbers_whose_squares_are_numbers(value: str) -> None:
    text = f"{embedded_text('ideal')}\n[simulation.override.sense_anti_phase]\nquality = {value}\n"
    with pytest.raises(
        ConfigError, match=r"simulation\.override\.sense_anti_phase\.quality: expected 0, or a number from"
    ):
        parse_bench(text, "lab.toml")


def test_unknown_key_is_one_readable_line() -> None:
    for known in (*BenchDescription.__struct_fields__, *Knowledge.__struct_fields__):
        for name in (f"{known}x", "bananas", known.partition("_")[0] + "_of_mine"):
            said = one_of(name, BenchDescription.__struct_fields__, "key")
            assert len(said) < 160
    assert one_of("rates", ["a", "b"], "key") == "one of a, b"
    assert one_of("resolution", ["meter_resolution_v", "nplc"], "key") == "a known key ('meter_resolution_v'?)"
