"""Layouts that loggers and people write: each is read right, or refused with the option that says what is missing."""

from __future__ import annotations

import importlib
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.cells import few
from vcfbench.analysis.column_names import Kind, column_name
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import analyze
from vcfbench.archive.analyzed_record import analyze_record
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

RATES = (0.5 + 0.25 * np.random.default_rng(3).standard_normal(80)).round(3).tolist()
MEAN = float(np.mean(RATES))


def log(head: str, row: str = "{t:.2f},{x}", count: int = 80, *, comma: bool = False) -> str:
    """A log of 100 readings a second; in `row` t is the time, s, x the rate, deg/s, k the number of the line."""
    rows = (row.format(t=0.01 * k, x=f"{RATES[k]:.3f}", h=3.6e6 * RATES[k], v=RATES[k], k=k) for k in range(count))
    return head + "".join((each.replace(".", ",") if comma else each) + "\n" for each in rows)


@pytest.mark.parametrize(
    ("field", "wrong"),
    [
        *((field, 3.5) for field in Layout.__struct_fields__),
        *((field, "gz") for field in ("columns", "skip", "units", "rows")),
        ("rows", ("sensor", "=", "GYRO")),
    ],
)
def test_a_wrong_kind_of_layout_is_refused(field: str, wrong: Any) -> None:
    with pytest.raises(ConfigError, match=f"^{field}: expected .*, got "):
        Layout(**{field: wrong})


RIGHT: dict[str, tuple[str, dict[str, Any], float | None]] = {
    "comments": (log("# logger 3\n# rate 100 Hz\ngyro [deg/s]\n", "{x}"), {}, 100.0),
    "savetxt": (log("# t_s,gyro [deg/s]\n"), {}, None),
    "decimal commas": (log("Zeit [s];Drehrate [deg/s]\n", "{t:.2f};{x}", comma=True), {}, None),
    "tabs": (log("t_s\tgyro [deg/s]\n", "{t}\t{x}"), {}, None),
    "spaces": (log("t_s   gyro_deg_s\n", "  {t}    {x}"), {}, None),
    "spaces and brackets": (log("time (s) gyro (deg/s)\n", "{t} {x}"), {}, None),
    "no names": (log(""), {"columns": ("t_s", "gyro_dps")}, None),
    "no names, a column left out": (log("", "{t},7,{x}"), {"columns": ("t_s", "", "gyro_dps")}, None),
    "trailing comma": (log("t_s,gyro [deg/s],\n", "{t},{x},"), {}, None),
    "row of units": (log("t,gyro,volts\ns,deg/s,-\n", "{t},{x},x"), {}, None),
    "row of bracketed units": (log("time,gyro\n[s],[deg/s]\n"), {}, None),
    "sep of Excel": (log("sep=;\nt_s;gyro [deg/s]\n", "{t};{x}"), {}, None),
    "Latin-1": (log("t_s,gyro [\xb0/s]\n"), {}, None),
    "comment at the end": (log("t_s,gyro [deg/s]\n") + "\n\n# end\n", {}, None),
    "comment in the middle": (log("t_s,gyro [deg/s]\n# x\n"), {}, None),
    "preface": (log("Logger 7\nSerial,4\n\nt_s,gyro [deg/s]\n"), {"skip": 3}, None),
    "text beside": (log("t_s,state,gyro [deg/s],when\n", '{t},"a, b",{x},1.1.2026'), {}, None),
    "empty cells beside": (log("t_s,gps_m,gyro [deg/s]\n", "{t},,{x}"), {}, None),
    "temperature beside": (log("t_s,gyro [deg/s],temp [\u00b0C],acc_g\n", "{t},{x},25.1,1.0"), {}, None),
    "one of three axes": (log("t_s,x_dps,y_dps,z_dps\n", "{t},1,2,{x}"), {"columns": ("z_dps",)}, None),
    "doubled names": (log("t_s,g_dps,g_dps\n", "{t},1,{x}"), {"columns": ("t_s", "", "z_dps")}, None),
    "dates": (log("time,gyro_dps\n", "2026-11-29T10:00:{k:02d}.5,{x}", 60), {}, None),
    "microseconds": (log("timestamp_us,gyro_dps\n", "{k}0000,{x}"), {}, None),
    "Unix time in ns": (log("timestamp [ns],gyro_dps\n", "15018221{k:02d}0000000000,{x}"), {}, None),
    "millis": (log("millis,gyro_dps\n", "{k}0,{x}"), {}, None),
    "index without a name": (log(",t_s,gyro_dps\n", "{k},{t:.2f},{x}"), {}, None),
    "EuRoC": (
        log("#timestamp [ns],w_x [rad s^-1],a_x [m s^-2],gz [deg/s]\r\n", "{k}0000000,9,9.8,{x}\r"),
        {"columns": ("gz [deg/s]",)},
        None,
    ),
    "phyphox": (log('"Time (s)","Gyroscope z (deg/s)"\n', "{t:.9E},{x}"), {}, None),
    "quoted decimal commas": (log('"t_s","gyro_dps"\n', '"{t}","{x}"', comma=True), {"decimal": "comma"}, None),
    "no names, dates first": (
        log("", "2026-11-29 10:00:0{t:.2f},{x}", 80),
        {"columns": ("time", "gyro_dps")},
        None,
    ),
    "unit by hand": (log("time,gz\n"), {"units": {"time": "s", "gz": "deg/s"}}, None),
    "times not looked at": (log("time,gyro_dps\n", "7,{x}"), {"time": "none"}, 100.0),
    "preface of texts": (
        log("Test,Rest\nModel,DMM6500\n\nIndex,gz_dps,Unit,Math,Start,t_s\n", "{k},{x},Volt DC,F,F,{t}"),
        {"skip": 3, "columns": ("gz_dps",)},
        None,
    ),
    "times of day": (log("time,gz_dps\n", "10:00:0{t:.3f},{x}"), {}, None),
    "dates by another name": (log("utc,gz_dps\n", "2026-11-29T10:00:0{t:.2f}Z,{x}"), {}, None),
    "sep of a tab, units below": (log("sep=\t\na_Timestamp\ta_Gyro\t\ns\tdeg/s\t\n", "{t}\t{x}\t"), {}, None),
    "a separator of its own": (log("t_s | gz_dps\n", "{t} | {x}"), {"separator": "|"}, None),
    "commas of thousands": (log("t_s;gz [mdeg/h]\n", "{t};{h:,.1f}"), {"decimal": "point"}, None),
    "milli": (log("t_s,gyro [mdps]\n", "{t},{x}e3"), {}, None),
    "Fortran": (log("t_s,gyro [deg/s]\n", "{t},{x}D+00"), {}, None),
    "LabVIEW": (
        log("LabVIEW Measurement\t\n***End_of_Header***\t\nX\tgz\tComment\n", "{t}\t{x}"),
        {"skip": 2, "units": {"X": "s", "gz": "deg/s"}, "columns": ("gz",), "time": "X"},
        None,
    ),
    "counters beside": (log("t_s,gz [LSB],error_count,loop_counts\n", "{t},{x},0,1"), {"units": {"": "dps"}}, None),
    "a minute": (log("t_s,gyro [deg/min]\n", "{t},{x}e0"), {}, None),
}


@pytest.mark.parametrize("case", few(RIGHT, every=2))
def test_layout_is_read_right(case: str, tmp_path: Path) -> None:
    text, told, rate = RIGHT[case]
    (tmp_path / "log.csv").write_bytes(text.encode("latin-1" if case == "Latin-1" else "utf-8"))
    if case == "dates":  # one a second, too few
        with pytest.raises(ConfigError, match="64 readings at least, got 60"):
            analyze_record(tmp_path / "log.csv", rate, layout=Layout(**told))
        return
    read = analyze_record(tmp_path / "log.csv", rate, layout=Layout(**told))
    assert read.interval_s == pytest.approx(10.0 if "Unix" in case else 0.01)
    assert read.mean_deg_s == pytest.approx(MEAN / (60.0 if case == "a minute" else 1.0))
    assert read.samples == 80


@pytest.mark.parametrize("separator", few([",", ", ", "\t", ";", " "], every=4))
@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("named", [True, False])
def test_lines_of_serial_monitor_have_their_times(tmp_path: Path, separator: str, columns: int, *, named: bool) -> None:
    names = ["gx_dps", "gy_dps", "gz_dps"][-columns:]
    body = [separator.join(["-0.25"] * (columns - 1) + [f"{rate}"]) for rate in RATES]
    times = [f"{'23:59:59' if k < 40 else '00:00:00'}.{(600 + 10 * k) % 1000:03d}" for k in range(80)]
    lines = [f"{time} -> {each}\n" for time, each in zip(times, body, strict=True)]
    head = f"23:59:59.590 -> {separator.join(names)}\n" if named else ""
    (tmp_path / "log.txt").write_text(head + "".join(lines))
    every = ("time", *[""] * (columns - 1), names[-1])
    read = analyze_record(tmp_path / "log.txt", layout=Layout(columns=(names[-1],) if named else every))
    assert (read.samples, read.interval_s) == (80, pytest.approx(0.01))
    assert read.mean_deg_s == pytest.approx(MEAN)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("size", few([80, 9000], 80))
def test_text_is_read_in_any_unicode_with_any_line_ends(tmp_path: Path, encoding: str, end: str, size: int) -> None:
    text = "".join(f"{0.01 * k:.2f},{RATES[k % 80]}{end}" for k in range(size))
    mark = "\ufeff" if encoding in {"utf-16-le", "utf-16-be"} else ""
    (tmp_path / "log.txt").write_bytes(f"{mark}t_s,gyro [\u00b0/s]{end}{text}".encode(encoding))
    read = analyze_record(tmp_path / "log.txt")
    assert read.samples == size
    assert read.mean_deg_s == pytest.approx(np.resize(RATES, size).mean())


@pytest.mark.parametrize("content", [b"\xff\xfet", b"\xff\xfet\0\0\xd8", b"\xfe\xff\0"])
def test_text_cut_within_a_sign_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "log.txt").write_bytes(content)
    with pytest.raises(ConfigError, match=r"UTF-16|the file"):
        analyze_record(tmp_path / "log.txt")


def test_binary_files_are_read_by_the_same_grammar(tmp_path: Path) -> None:
    times, rates = 0.01 * np.arange(80.0), np.array(RATES)
    np.save(tmp_path / "log.npy", np.column_stack([times, rates]))
    np.save(tmp_path / "named.npy", np.array(list(zip(times, rates, strict=True)), [("t_s", "f8"), ("x_dps", "f8")]))
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "log.mat", {"t_s": times, "x_dps": rates, "who": "somebody", "n": 3.0})
    names = {"log.npy": ("t_s", "x_dps")}
    np.savez(tmp_path / "log.npz", t_s=times, x_dps=rates, who=np.array("somebody"))
    written = ["log.npy", "named.npy", "log.npz", "log.mat"]
    if (openpyxl := pytest.importorskip("openpyxl")) and (arrow := pytest.importorskip("pyarrow")):
        book = openpyxl.Workbook()
        for row in (("t_s", "x [deg/s]", "note"), *zip(times, rates, ["a, b"] * 80, strict=True)):
            book.active.append(row)
        book.save(tmp_path / "log.xlsx")
        table = arrow.table({"t_s": times, "x_dps": rates})
        importlib.import_module("pyarrow.parquet").write_table(table, tmp_path / "log.parquet")
        written += ["log.xlsx", "log.parquet"]
    if tdms := pytest.importorskip("nptdms"):
        waveform = {"unit_string": "deg/s", "wf_increment": 0.01}
        with tdms.TdmsWriter(tmp_path / "log.tdms") as file:
            file.write_segment([tdms.ChannelObject("Log", "x", np.array(rates), waveform)])
        written += ["log.tdms"]
    for name in written:
        found = analyze_record(tmp_path / name, layout=Layout(columns=names.get(name, ())))
        assert found.samples == 80, name
        assert found.mean_deg_s == pytest.approx(MEAN), name
        assert found.interval_s == pytest.approx(0.01)


def test_struct_of_matlab_is_refused_with_how_to_save_it(tmp_path: Path) -> None:
    pytest.importorskip("scipy.io").savemat(tmp_path / "log.mat", {"log": {"t": [1.0, 2.0], "x": [1.0, 2.0]}})
    with pytest.raises(ConfigError, match="got none") as error:
        analyze_record(tmp_path / "log.mat")
    assert error.value.hint == "save the fields of log as variables, as by save -struct"


LIBRARIES = {".xlsx": "openpyxl", ".parquet": "pyarrow", ".tdms": "nptdms"}


@pytest.mark.parametrize("suffix", [".xlsx", ".npy", ".npz", ".mat", ".parquet", ".tdms"])
def test_file_that_is_not_what_its_name_says_is_refused(tmp_path: Path, suffix: str) -> None:
    if suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[suffix], reason="pip install '.[dev]'")
    (tmp_path / f"log{suffix}").write_text("no such thing")
    with pytest.raises(ConfigError, match=r"log.*: expected a"):
        analyze_record(tmp_path / f"log{suffix}")


TDMS_REFUSED: dict[str, tuple[list[tuple[str, str, int, float | None]], str]] = {
    "two groups": ([("A", "x_dps", 9, None), ("B", "x_dps", 9, None)], "one group with channels, got A, B"),
    "two lengths": ([("A", "x_dps", 9, None), ("A", "y_dps", 8, None)], "x_dps of 9 by None s, y_dps of 8"),
    "two intervals": ([("A", "x_dps", 9, 0.01), ("A", "y_dps", 9, 0.1)], "by 0.01 s, y_dps of 9 by 0.1 s"),
    "nothing": ([("A", "x_dps", 0, None)], "got none"),
}


@pytest.mark.parametrize("what", TDMS_REFUSED)
def test_tdms_file_without_one_table_is_refused(tmp_path: Path, what: str) -> None:
    tdms = pytest.importorskip("nptdms", reason="pip install '.[dev]'")
    channels, expected = TDMS_REFUSED[what]
    with tdms.TdmsWriter(tmp_path / "log.tdms") as file:
        for group, name, length, interval_s in channels:
            properties = {} if interval_s is None else {"wf_increment": interval_s}
            file.write_segment([tdms.ChannelObject(group, name, np.ones(length), properties)])
    with pytest.raises(ConfigError, match=re.escape(expected)):
        analyze_record(tmp_path / "log.tdms")


REFUSED: dict[str, tuple[str, str]] = {
    "no names": (log("", "{x}"), "--columns"),
    "preface": (log("Logger 7\nSerial 4\nt_s,gyro [deg/s]\n"), "--skip 2"),
    "header of LabVIEW": (log("Writer\t2\nA\tB\n***End***\t\nt_s\tx_dps\tC\n", "{t}\t{x}\t"), "--skip 3"),
    "LabVIEW": (log("LabVIEW Measurement\t\nA\t2\n***End_of_Header***\t\nX\tY\tComment\n", "{t}\t{x}"), "--skip 3"),
    "SignalExpress": (log("channel names:\t\nai0\t\ndt:\t\n0.01\t\ndata:\t\n", "{x}\t"), "--skip 4"),
    "missing": (log("t_s,gyro_dps\n") + "0.8,\n0.81,0.5\n", "take the line out"),
    "names again": (log("t_s,gyro_dps\n") + "t_s,gyro_dps\n", "take the line out"),
    "footer": (log("t_s,gyro_dps\n") + "Max,0.4\n", "take the line out"),
    "empty line": (log("t_s,gyro_dps\n") + "\n0.81,0.5\n", "take it out"),
    "counters alone": (log("t_s,x,y,error_count\n", "{t},{x},1,0"), "--columns"),
    "series on a table": (log("t_s,table_rate [dps],out [V]\n", "{t},{x},1"), "--columns RATE,OUTPUT"),
    "unknown unit": (log("t_s,gyro [furlong]\n"), "--unit"),
    "capital M": (log("t_s,gyro [MV]\n"), "--unit"),
    "no unit": (log("t_s,gyro\n"), "--unit"),
    "unit at the end of a longer one": (log("wz_furlong_s\n", "{x}"), "--unit"),
    "two axes": (log("t_s,x_dps,y_dps\n", "{t},{x},1"), "--columns"),
    "a rate and a reference voltage": (log("wz_mrad_s,vref_v\n"), "--columns"),
    "times without unit": (log("time,gyro_dps\n"), "--unit time=s"),
    "two times": (log("t_s,time_ms,gyro_dps\n", "{t},{k}0,{x}"), "--time"),
    "times that stand": (log("t_s,gyro_dps\n", "7,{x}"), "--time none"),
    "times backwards": (log("t_s,gyro_dps\n", "-{t},{x}"), "--time none"),
    "volts": (log("t_s,gyro_mv\n"), "--scale-factor"),
    "counts": (log("t_s,gyro [LSB]\n"), "--scale-factor"),
    "thousands": (log("t_s;gyro_dps\n", "{k};1,500"), "--decimal"),
    **{
        f"hexadecimal {cell}": (log("t_s,gyro_dps\n", f"{{t}},{cell}"), "hexadecimal: write counts as decimals")
        for cell in ("0x1f", "0XFFE1", "004D", "004d", "1FFh")
    },
    "cut off in a number": (log("t_s,gyro_dps\n") + "0.8,0.", "ends within a number"),
    "cut off behind a comma": (log("t_s,gyro_dps\n") + "0.8,", "line 82, column gyro_dps: the value is missing"),
    "not a number": (log("t_s,gyro_dps\n") + "0.8,NaN\n", "line 82, column gyro_dps: NaN is not a measured value"),
    "no reading": (log("t_s,gyro_dps\n") + "0.8,9.91E37\n", "line 82, .*instrument's word"),
    "text above texts": (log("Test,Rest\nModel,X\n\nIndex,gz,Unit,Math,t_s\n", "{k},{x},V,F,{t}"), "--skip 3"),
    "name in each cell": (log("", "gx:{t},gz:{x}"), "line 1: expected names above numbers alone"),
    "comments alone": (log("", "%RAW,{t},{x}"), "the file has comments alone"),
    "volts DC": (log("t_s,Scan,Reading (VDC)\n", "{t},{k},{x}"), "--scale-factor"),
    "no such separator": (log("t_s | gz_dps\n", "{t} | {x}"), r"--separator '\|'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_layout_is_refused_with_what_would_cure_it(case: str, tmp_path: Path) -> None:
    text, words = REFUSED[case]
    (tmp_path / "log.csv").write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=words):
        analyze_record(tmp_path / "log.csv")


def test_stated_rate_must_be_that_of_the_times(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(log("t_s,gyro_dps\n"))
    assert analyze_record(tmp_path / "log.csv", 100.5).interval_s == pytest.approx(0.01)
    for rate in (50.0, 102.0, 1e300, math.inf):
        with pytest.raises(ConfigError, match="--rate"):
            analyze_record(tmp_path / "log.csv", rate)


TABLES: dict[str, tuple[str, str, float, str]] = {
    "volts": ("rate_deg_s,a", "a", 1.0, "V"),
    "millivolts": ("rate_deg_s,a [mV]", "a [mV]", 1e-3, "V"),
    "microvolts": ("rate_deg_s,a [\u00b5V]", "a [\u00b5V]", 1e-6, "V"),
    "counts": ("rate / (deg/s),a [LSB]", "a [LSB]", 1.0, "LSB"),
    "rates": ("applied [rad/s],gyro [rad/s]", "gyro [rad/s]", 1.0, "deg/s"),
    "rate last": ("a [mV],rate (rad/s)", "a [mV]", 1e-3 / math.degrees(1.0), "V"),
}


@pytest.mark.parametrize("case", TABLES)
def test_table_is_in_the_units_of_its_columns(case: str, tmp_path: Path) -> None:
    head, column, expected, unit = TABLES[case]
    swapped = head.startswith("a [")
    rows = "".join(f"{2 * x},{x}\n" if swapped else f"{x},{2 * x}\n" for x in (-3, -2, -1, 0, 1, 2, 3))
    (tmp_path / "table.csv").write_text(f"{head}\n{rows}", "utf-8")
    found = analyze(tmp_path / "table.csv")
    assert found.series[column].line.scale_factor == pytest.approx(2.0 * expected)
    assert found.units == {column: unit}
    plain = found.as_json()["series"][column]
    assert plain["scale_factor"]["unit"] == {"V": "V/(deg/s)", "deg/s": "1"}.get(unit, f"{unit}/(deg/s)")
    assert any(name.endswith("_v") for name in plain) == (unit == "V")
    found.report()


@pytest.mark.parametrize("unit", ["mV/V", "V/V", "LSB/V", "uV/mA", "MV", "MDPS", "MRAD_S", "Mdeg/s"])
@pytest.mark.parametrize("name", ["{}", "out {}", "OUT_{}", "out / {}", "out [{}]"])
def test_unit_of_unknown_size_is_not_taken_for_volts(unit: str, name: str, tmp_path: Path) -> None:
    rows = "".join(f"{x},{2 * x}\n" for x in (-3, -2, -1, 0, 1, 2, 3))
    (tmp_path / "table.csv").write_text(f"applied [deg/s],{name.format(unit)}\n{rows}")
    with pytest.raises(ConfigError, match="column ") as error:
        analyze(tmp_path / "table.csv")
    assert "--unit" in (error.value.hint or "")


def test_columns_that_are_no_output_are_named_and_not_fitted(tmp_path: Path) -> None:
    rows = "".join(f"{k},{x},{-2 * x},0.1,25.{k},ok,3\n" for k, x in enumerate((-3, -1, 0, 1, 3)))
    head = "t_s,rate [dps],out [mV],u_out [mV],temperature_c,state,n\n"
    (tmp_path / "table.csv").write_text(head + rows)
    found = analyze(tmp_path / "table.csv")
    assert list(found.series) == ["out [mV]"]
    assert found.series["out [mV]"].type_a is not None
    assert found.series["out [mV]"].type_a.u_output_v == pytest.approx(1e-4)
    assert found.notes == ("not analysed: t_s, temperature_c, state, n",)


SIGNS = [
    ("CW", "CCW"),
    ("left", "right"),
    ("+", "-"),
    ("Rechts", "Links"),
    ("clockwise", "counterclockwise"),
    ("1", "-1"),
]


@pytest.mark.parametrize("words", SIGNS)
@pytest.mark.parametrize("one_sided", [False, True])
def test_rates_without_sign_beside_their_directions_are_refused(
    tmp_path: Path, words: tuple[str, str], *, one_sided: bool
) -> None:
    rates = (
        [-10.0, 0.0, 10.0, 50.0, 100.0, 150.0, 200.0, 250.0]
        if one_sided
        else [-200.0, -100.0, -50.0, 0.0, 50.0, 100.0, 200.0]
    )
    file = tmp_path / "table.csv"
    for signed in (True, False):
        rows = [f"{words[x < 0]},{x if signed else abs(x)},{2.41 - 0.0125 * x}" for x in rates]
        file.write_text("\n".join(["dir,rate_dps,out_V", *rows]))
        for layout in (Layout(), Layout(columns=("rate_dps", "out_V"))):
            if signed:
                assert analyze(file, layout=layout).series["out_V"].line.scale_factor == pytest.approx(-0.0125)
                continue
            with pytest.raises(ConfigError, match=r"dir: .* beside rates without sign"):
                analyze(file, layout=layout)
    if one_sided:
        found = analyze(file, layout=Layout(rows=("dir", words[0])))
        assert found.series["out_V"].line.scale_factor == pytest.approx(-0.0125)


@pytest.mark.parametrize("name", ["fit [V]", "residual [V]", "out_fitted [V]", "deviation [mV]", "error [V]"])
def test_columns_of_another_fit_are_no_outputs(tmp_path: Path, name: str) -> None:
    rows = "".join(f"{x},{-2 * x + 0.1 * x**2},{1e-3 * x**2}\n" for x in (-3, -1, 0, 1, 3))
    (tmp_path / "table.csv").write_text(f"rate [dps],out [V],{name}\n" + rows)
    assert list(analyze(tmp_path / "table.csv").series) == ["out [V]"]


@pytest.mark.parametrize("unit", few(["V", "mV", "VDC", "Volt DC", "uV"], every=4))
@pytest.mark.parametrize("head", ["Reading,Unit", "Value,Units", "Reading [],unit", "Reading [{}],Unit"])
def test_unit_in_a_column_of_its_own_is_that_of_the_column_before(tmp_path: Path, unit: str, head: str) -> None:
    factor = {"mV": 1e-3, "uV": 1e-6}.get(unit, 1.0)
    file, rest = tmp_path / "dmm.csv", tmp_path / "rest.csv"
    names, column = head.format(unit), head.format(unit).split(",")[0]
    file.write_text(f"rate_dps,{names}\n" + "".join(f"{x},{0.5 * x / factor!r},{unit}\n" for x in (-3, -1, 0, 2, 4)))
    found = analyze(file)
    assert found.series[column].line.scale_factor == pytest.approx(0.5)
    assert found.notes == (f"not analysed: {names.split(',')[1]}",)
    rest.write_text(log(f"t_s,{names}\n", f"{{t}},{{x}},{unit}"))
    read = analyze_record(rest, scale_factor_per_deg_s=0.5, layout=Layout(columns=(column,)))
    assert read.mean_deg_s == pytest.approx(2.0 * MEAN * factor)
    with pytest.raises(ConfigError, match=f"column {re.escape(column)}: the name says kV"):
        analyze(file, layout=Layout(units={column: "kV"}))


def test_supply_is_no_output(tmp_path: Path) -> None:
    rows = "".join(f"{x},{-2 * x + 0.1 * x**2},5.0{k}\n" for k, x in enumerate((-3, -1, 0, 1, 3)))
    (tmp_path / "table.csv").write_text("rate [dps],out [mV],supply [V]\n" + rows)
    found = analyze(tmp_path / "table.csv")
    assert list(found.series) == ["out [mV]"]
    assert found.notes == ("not analysed: supply [V]",)


def test_rows_of_the_two_biases_have_names_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("rate [dps],out [dps]\n-1,-1.9\n0,0.1\n1,2.1\n")
    text = str(analyze(tmp_path / "table.csv").report())
    assert text.count("'bias, deg/s'") == 1
    assert "bias over scale factor, deg/s" in text


def test_axes_of_a_record_are_no_table(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(log("t_s,x_dps,y_dps\n", "{t},{x},1"))
    with pytest.raises(ConfigError, match="of a record at rest one column is analysed at a time"):
        analyze(tmp_path / "log.csv", layout=Layout(columns=("x_dps", "y_dps")))


def test_unit_of_a_table_is_that_of_a_named_column(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("rate_dps,a\n-1,1\n0,2.1\n1,3\n")
    found = analyze(tmp_path / "table.csv", layout=Layout(units={"a": "mV"}))
    assert found.series["a"].line.scale_factor == pytest.approx(1e-3)
    with pytest.raises(ConfigError, match="expected the column too"):
        analyze(tmp_path / "table.csv", layout=Layout(units={"": "mV"}))
    with pytest.raises(ConfigError, match="expected a unit of"):
        analyze(tmp_path / "table.csv", layout=Layout(units={"a": "furlong"}))


def test_outputs_in_different_units_are_not_compared(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("rate_deg_s,a_mv,b [LSB]\n-1,1,2\n0,2.1,3\n1,3,4\n")
    assert analyze(tmp_path / "table.csv").comparison is None
    with pytest.raises(ConfigError, match="a_mv in V and b \\[LSB\\] in LSB cannot be compared"):
        analyze(tmp_path / "table.csv", ["a_mv", "b [LSB]"])


@pytest.mark.parametrize(
    ("name", "kind", "factor"),
    [
        *((name, Kind.RATE, 1.0) for name in ("rate / (deg/s)", "GyroX(deg/s)", "gyro deg/s", "yaw rate in deg/s")),
        *((name, Kind.RATE, 1.0) for name in ("x_dps", "x_deg_per_s", "x [\u00b0/s]", "x [deg s^-1]", "x/deg/s")),
        *((name, Kind.RATE, 1 / 3600) for name in ("x [deg/hr]", "x (\u00b0/h)", "x_deg_h", "x deg/h")),
        *((name, Kind.RATE, math.degrees(1.0)) for name in ("x [rad s^-1]", "x_rad_s", "x [rad\u00b7s\u207b\u00b9]")),
        *((name, Kind.RATE, 1e-3) for name in ("x [mdps]", "x_mdeg_s", "x [mdeg/s]")),
        *(
            (name, Kind.RATE, 0.1)
            for name in ("x [0.1 deg/s]", "x [1e-1 deg/s]", "x (10^-1 \u00b0/s)", "x [10\u207b\u00b9 dps]")
        ),
        *((name, Kind.RATE, 0.9) for name in ("x [gon/s]", "x_gon_s")),
        *((name, Kind.VOLTAGE, 1e-6) for name in ("x [\u00b5V]", "x [\u03bcV]", "x_uv")),
        *((name, Kind.TIME, 1e-3) for name in ("t_ms", "time [ms]", "millis")),
        *((name, Kind.COUNT, 1.0) for name in ("x [LSB]", "x_counts", "adc_raw")),
        *((name, None, None) for name in ("x [V] (deg/s)", "Rate (deg/s) raw counts", "x [deg/s x100]", "x [rps]")),
        *((name, None, None) for name in ("x [deg/s\u00b2]", "x [250 deg/s]", "x [131 LSB]", "x [1/s]", "x (10 V)")),
        *((name, None, None) for name in ("x", "wz_foo_s", "x [MV]", "gyro (z)", "temperature / h", "u_x_v", "x_std")),
        *((name, None, None) for name in ("x_mV/V", "x LSB/dps", "gain (deg/s)/V", "x [(deg/s)^2]", "x [mV/V]", "x_h")),
    ],
)
def test_unit_is_longest_end_of_name_that_is_a_unit(name: str, kind: Kind | None, factor: float | None) -> None:
    found = column_name(name)
    assert found.kind is kind
    if factor is not None:
        assert found.unit is not None
        assert found.unit.factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("rps", "--unit 'gz [rps]=rev/s', or rad/s"),
        (
            "deg/s x100",
            "--unit 'gz [deg/s x100]=1e-2 deg/s' if numbers were multiplied, 'gz [deg/s x100]=1e2 deg/s' if",
        ),
        ("deg/s\u00b2", None),
        ("V] [deg/s", None),
    ],
)
def test_unknown_unit_has_no_cure_but_what_it_may_be(tmp_path: Path, unit: str, words: str | None) -> None:
    (tmp_path / "log.csv").write_text(log(f"t_s,gz [{unit}]\n"), "utf-8")
    with pytest.raises(ConfigError, match=r"expected a unit in its name") as error:
        analyze_record(tmp_path / "log.csv")
    assert (error.value.hint or "").startswith(words or "--unit with that of its numbers")


def test_rates_in_the_place_of_volts_are_told(tmp_path: Path) -> None:
    file = tmp_path / "exchanged.csv"
    rows = [f"{-0.0125 * rate - 0.0414},{rate}" for rate in (-200, -100, 0, 100, 200)]
    file.write_text("\n".join(["rate_deg_s,output_v", *rows]))
    assert analyze(file).notices == ("output_v: outputs up to 200 V: are the columns of rates and outputs exchanged?",)
