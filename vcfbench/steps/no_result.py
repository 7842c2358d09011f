"""Arithmetic that failed on readings: the expression and its inputs."""

import ast
import itertools
import linecache
from contextlib import suppress
from types import FrameType, TracebackType

from vcfbench.errors import Aborted, BenchError, MeasurementError

_OURS = f"{__name__.partition('.')[0]}."


def as_bench_error(error: BaseException, number: int) -> BenchError:
    """Return the error that ended step `number`, or the plan behind it; raises a mistake in a program."""
    if isinstance(error, BenchError):
        return Aborted.behind(error) or error
    if isinstance(error, KeyboardInterrupt):
        return Aborted("stopped by the operator")
    if is_arithmetic(error):
        return no_result(error, f"the readings of step {number}")
    raise error


def is_arithmetic(error: BaseException) -> bool:
    """Tell whether it is one of numbers, and of code that comes along: of anybody's own code it is a mistake there."""
    kinds = {kind.__name__ for kind in type(error).__mro__}
    math_said = isinstance(error, ValueError) and "math domain" in str(error)
    if not (kinds & {"ArithmeticError", "LinAlgError"} or math_said):
        return False
    frames = [frame for frame, _ in _frames(error.__traceback__)]
    return bool(frames) and frames[-1].f_globals.get("__name__", "").startswith((_OURS, "numpy.", "scipy."))


def no_result(error: BaseException, of_what: str) -> MeasurementError:
    """Return the error of readings without a result: their name, the expression, and its values."""
    frame, instruction = next(
        (each for each in reversed(_frames(error.__traceback__)) if each[0].f_globals["__name__"].startswith(_OURS)),
        (None, 0),
    )
    said = "" if frame is None else _expression(frame, instruction)
    return MeasurementError(f"{of_what} make no result ({error}{said})")


def _frames(traceback: TracebackType | None) -> list[tuple[FrameType, int]]:
    frames = []
    while traceback is not None:
        frames.append((traceback.tb_frame, traceback.tb_lasti))
        traceback = traceback.tb_next
    return frames


def _expression(frame: FrameType, instruction: int) -> str:
    """Return the expression that failed, with the values of its names; nothing where its source is not at hand."""
    place = next(itertools.islice(frame.f_code.co_positions(), instruction // 2, None))
    first, last, begin, end = place
    if first is None or first != last:
        return ""
    text = linecache.getline(frame.f_code.co_filename, first).encode()[begin:end].decode()
    known = {**frame.f_globals, **frame.f_locals}
    values: dict[str, str] = {}
    with suppress(SyntaxError):
        for node in ast.walk(ast.parse(text, mode="eval")):
            value = known.get(node.id) if isinstance(node, ast.Name) else None
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                value = getattr(known.get(node.value.id), node.attr, None)
            if isinstance(value, int | float):
                values[ast.unparse(node)] = f"{value:.6g}"
    return f": {text}" + "".join(f", {name} = {value}" for name, value in values.items())
