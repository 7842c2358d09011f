"""Reports, figures and certificates of runs as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import shown
from vcfbench.runs.reported import full_report, title_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.report.document import Figure, Report
    from vcfbench.runs.run import Run

__all__ = ["write_document", "write_report"]


def write_report(run: Run, path: str | Path) -> tuple[Path, ...]:
    """Write the whole report of `run` into `path` and return the files that were written, the report first.

    Args:
        run: any run, also one read back: ``vcfbench.load_run("last")``.
        path: its suffix says as what: ``.html``, one file that needs nothing beside itself; ``.pdf``, which needs
            ``pip install 'vcfbench[pdf]'``; ``.md``, with a file ``NAME-1.svg`` beside it for each figure.

    Raises:
        ConfigError: the suffix is none of these, the record cannot be read, or the file cannot be written.
    """
    return write_document(full_report(run), title_of(run), run.name or run.procedure, Path(path))


def write_document(report: Report, title: str, name: str, path: Path) -> tuple[Path, ...]:
    """Write `report` as :func:`write_report` does; `name` stands at the head of printed pages."""
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise ConfigError(f"{shown(path)}: expected a name that ends in {', '.join(_WRITERS)}")
    try:
        return writer(report, title, name, path)
    except OSError as error:
        raise ConfigError(f"{shown(path)}: cannot be written: {error.strerror}") from error


def _html(report: Report, title: str, name: str, path: Path) -> tuple[Path, ...]:
    from vcfbench.report.page import page_of  # noqa: PLC0415

    path.write_bytes(page_of(report, f"{title} ({name})", name).encode())
    return (path,)


def _pdf(report: Report, title: str, name: str, path: Path) -> tuple[Path, ...]:
    from vcfbench.report.page import page_of  # noqa: PLC0415

    weasyprint = need("weasyprint", "pdf", "a report as PDF")
    page = page_of(report, f"{title} ({name})", name, printed=True)
    path.write_bytes(weasyprint.HTML(string=page, url_fetcher=_nothing_from_elsewhere).write_pdf())
    return (path,)


def _nothing_from_elsewhere(url: str) -> dict[str, object]:
    """Refuse every address: a report holds all that it shows."""
    raise ConfigError(f"a report asks for nothing from elsewhere, came {url!r}")


def _markdown(report: Report, _title: str, _name: str, path: Path) -> tuple[Path, ...]:
    from urllib.parse import quote  # noqa: PLC0415

    from vcfbench.report.markdown import markdown_of  # noqa: PLC0415
    from vcfbench.report.plot import save_figure  # noqa: PLC0415

    pictures: list[Path] = []

    def place(figure: Figure, number: int) -> str:
        picture = path.with_name(f"{path.stem}-{number}.svg")
        save_figure(figure, picture)
        pictures.append(picture)
        return quote(picture.name)

    text = markdown_of(report, place)
    path.write_bytes(text.encode())
    return (path, *pictures)


_WRITERS: Final[dict[str, Callable[[Report, str, str, Path], tuple[Path, ...]]]] = {
    ".html": _html,
    ".pdf": _pdf,
    ".md": _markdown,
}
