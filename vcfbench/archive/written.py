"""Reports, figures and certificates of runs as files."""

from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from urllib.parse import quote

from vcfbench.archive.certificate import certificate_words, stated_words
from vcfbench.archive.dcc import dcc_of
from vcfbench.archive.reported import full_report, title_of
from vcfbench.archive.run import Run
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import read_file, replaced, shown
from vcfbench.reports.document import Figure, Report
from vcfbench.reports.html_page import page_of
from vcfbench.reports.markdown import markdown_of
from vcfbench.reports.plot import save_figure


def write_report(run: Run, path: str | Path, words: Mapping[str, str] | None = None) -> tuple[Path, ...]:
    """Write the whole report of `run` into `path` and return the files that were written, the report first.

    Args:
        run: any run, also one read back: ``vcfbench.load_run("last")``.
        path: its suffix says as what: ``.html``, one file that needs nothing beside itself; ``.pdf``, which needs
            ``pip install weasyprint``; ``.md``, with a file ``NAME-1.svg`` beside it for each figure.
        words: what no measurement gives, by the fields of `CertificateWords`; besides ``title``, that of the first
            page, and ``logo``, a file (``.png``, ``.jpg``, ``.svg``) that stands above it in HTML and PDF.

    Raises:
        ConfigError: the suffix is none of these, a word is unknown, the record or the logo cannot be read, or the file
            cannot be written.

    >>> [file.name for file in vcfbench.write_report(run, "G-0042.md", {"title": "Incoming inspection"})]
    ['G-0042.md', 'G-0042-1.svg', 'G-0042-2.svg']
    """
    said = dict(words or {})
    title, logo = said.pop("title", "") or title_of(run), said.pop("logo", "")
    name = stated_words(run, said).get("identifier") or run.procedure
    return write_document(full_report(run, said, title), title, name, Path(path), logo)


_SUFFIXES: Final = (".html", ".pdf", ".md")
_PICTURES: Final = {".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}
_LARGEST_LOGO: Final = 1 << 20
_LARGEST_DOCUMENT: Final = 1 << 26


def write_certificate(
    run: Run, path: str | Path, words: Mapping[str, str] | None = None, embed: str | Path | None = None
) -> Path:
    """Write `run` as a Digital Calibration Certificate (DCC, XML), not signed, and return the file.

    Args:
        run: one that is complete, with results that have uncertainties.
        path: where it goes, ``.xml``.
        words: what no measurement gives, by the fields of `CertificateWords`: ``{"customer": "ACME Ltd", ...}``; what
            the run's tags, its record or the bench file tell may be left out.
        embed: the report for people, a ``.pdf``, which the certificate then holds; None for none.

    Raises:
        ConfigError: something is missing (all of it in one), the run can have no certificate, or the file cannot be
            written.

    >>> customer = {"customer": "ACME Ltd", "customer_address": "1 Mill Lane, York"}
    >>> vcfbench.write_certificate(run, "G-0042.xml", customer).name
    'G-0042.xml'
    """
    path = Path(path)
    document = None if embed is None else (Path(embed).name, read_file(embed, "a report", _LARGEST_DOCUMENT))
    if document is not None and not document[1].startswith(b"%PDF"):
        raise ConfigError(f"{shown(Path(embed or ''))}: expected a report as PDF", hint="vcfbench report -o REPORT.pdf")
    written = dcc_of(run, certificate_words(run, words), document)
    with replaced(path) as draft:
        draft.write_bytes(written)
    return path


def write_figures(run: Run, path: Path, number: int | None = None) -> tuple[Path, ...]:
    """Draw the figures of the report of `run` into files and return those; of several each has its number in its name.

    Args:
        run: any run.
        path: its suffix says as what: ``.svg``, ``.png``, ``.pdf``.
        number: of the figure that is drawn alone, from 1; None for all.

    Raises:
        ConfigError: there is no such figure, the record cannot be read, or a file cannot be written.
    """
    figures = [part for part in full_report(run).parts if isinstance(part, Figure)]
    if not figures:
        raise ConfigError(f"run {run.name or run.procedure}: its report has no figure")
    if number is not None and not 1 <= number <= len(figures):
        raise ConfigError(f"run {run.name or run.procedure}: expected a figure from 1 to {len(figures)}, got {number}")
    chosen = {1: path} if len(figures) == 1 else {each: _numbered(path, each) for each in range(1, len(figures) + 1)}
    if number is not None:
        chosen = {number: path}
    for each, file in chosen.items():
        save_figure(figures[each - 1], file)
    return tuple(chosen.values())


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}-{number}{path.suffix}")


def write_document(report: Report, title: str, name: str, path: Path, logo: str | None = None) -> tuple[Path, ...]:
    """Write `report` as :func:`write_report` does; `name` heads printed pages.

    `logo` is a file, empty for none; None where the report has no first page.
    """
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ConfigError(f"{shown(path)}: expected a name that ends in {', '.join(_SUFFIXES)}")
    if logo:  # a picture becomes an address that holds it
        kind = _PICTURES.get(Path(logo).suffix.lower())
        if kind is None:
            raise ConfigError(f"logo {logo!r}: expected a name that ends in {', '.join(_PICTURES)}")
        picture = b64encode(read_file(Path(logo), "a logo", _LARGEST_LOGO)).decode()
        logo = f"data:{kind};base64,{picture}"
    if suffix == ".md":
        return _markdown(report, path)
    page = page_of(report, f"{title} ({name})", name, printed=suffix == ".pdf", logo=logo)
    with replaced(path) as draft:
        draft.write_bytes(_pdf(page) if suffix == ".pdf" else page.encode())
    return (path,)


def _pdf(page: str) -> bytes:
    try:
        weasyprint = need("weasyprint", "pdf", "a report as PDF")
    except OSError as error:  # its wheel brings no Pango
        hint = "install Pango (Debian: apt install libpango-1.0-0 libpangoft2-1.0-0), or print the .html"
        raise ConfigError(f"a report as PDF needs WeasyPrint, which cannot be loaded: {error}", hint=hint) from error
    # a report holds all that it shows, its logo too: nothing is asked for from elsewhere
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols=("data",), fail_on_errors=True)
    data: bytes = weasyprint.HTML(string=page, url_fetcher=fetcher).write_pdf()
    return data


def _markdown(report: Report, path: Path) -> tuple[Path, ...]:
    pictures: list[Path] = []

    def place(figure: Figure, number: int) -> str:
        picture = _numbered(path.with_suffix(".svg"), number)
        save_figure(figure, picture)
        pictures.append(picture)
        return quote(picture.name)

    with replaced(path) as draft:
        draft.write_bytes(markdown_of(report, place).encode())
    return (path, *pictures)
