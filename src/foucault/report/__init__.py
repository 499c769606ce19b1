"""The report: what a run folder holds as a document, and its printer as one self-contained page.

It formats and computes nothing. A kind of run is a module with `document`; what it says of a run is
the same on the page, on the screen and as JSON.
"""

from __future__ import annotations

import json
import re
from base64 import b64encode
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import platformdirs

from foucault.escape import figure
from foucault.files import atomic
from foucault.run_folder import REPORT_FILE, load_result

if TYPE_CHECKING:
    from jinja2.bccache import Bucket
    from markupsafe import Markup

    from foucault.report.page import Document
    from foucault.result import Result

_HERE = Path(__file__).parent
COLOURS = _HERE / "colours.css"  # Of reports and of the workbench, light and dark.


def write(folder: str | Path) -> Path:
    """Write report.html from what the run folder holds.

    Returns the report written: one HTML file that needs no network.
    """
    folder = Path(folder)
    return save(of_result(load_result(folder)), folder / REPORT_FILE)


def of_result(result: Result) -> Document:
    """Return what there is to say of a calibration."""
    from foucault.report import calibration

    return calibration.document(result)


def html(result: Result) -> str:
    """Return the report of `result` as HTML."""
    return render(of_result(result))


def save(document: Document | str, path: str | Path) -> Path:
    """Write a document, or its page as `render` has made it, as one self-contained HTML file."""
    path = Path(path)
    text = document if isinstance(document, str) else render(document)
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def render(document: Document) -> str:
    """Return a document as a self-contained page of HTML."""
    drawn = any(block.kind == "figure" for one in document.sections for block in one.blocks)
    return str(
        _template().render(
            head=document.heading,
            sections=document.sections,
            css="".join(f.read_text(encoding="utf-8") for f in (COLOURS, _HERE / "page.css")),
            js=(_HERE / "page.js").read_text(encoding="utf-8"),
            plotly=_plotly() if drawn else "",
        )
    )


def ready() -> None:
    """Load what every page needs, before one is asked for."""
    _template()
    _plotly()


@cache
def _plotly() -> str:
    """The library that turns and zooms figures, compressed, as a page holds it."""
    return b64encode((_HERE / "plotly.js.gz").read_bytes()).decode()


LONG_NAME = 26  # A dotted name of so many letters may break after every dot.

_PIECES = re.compile(r"[A-Za-z]\w*|\^-?\d+|\s+|.")


def _typeset(piece: str) -> Markup:
    """Write a matrix upright and bold, a vector or number italic, a power raised, a word as is."""
    from markupsafe import Markup, escape

    letter, _, index = piece.partition("_")
    if re.fullmatch(r"[a-z][xyz]", letter) and not index:
        letter, index = letter[0], letter[1]
    if piece[0] == "^":
        return Markup("<sup>{}</sup>").format(piece[1:].replace("-", "−"))
    if len(letter) > 1 or not letter.isalpha():
        return escape(piece.replace("-", "−"))
    tag = Markup("b" if letter.isupper() else "i")
    lowered = Markup("<sub>{}</sub>").format(index) if index else ""
    return Markup("<{0}>{1}</{0}>{2}").format(tag, letter, lowered)


@cache
def _template() -> Any:
    from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined
    from markupsafe import Markup, escape

    from foucault.report.page import GREEK, signs
    from foucault.report.seen import seen
    from foucault.report.still import svg

    def symbol(text: str) -> Markup:
        """Write ``b_ax`` with its index lowered."""
        letter, _, index = text.partition("_")
        return Markup("<i>{}</i><sub>{}</sub>").format(GREEK.get(letter, letter), index)

    def dotted(text: str) -> Markup:
        """Let a name break after its first dot, a long one after each, on a narrow screen."""
        return Markup(".<wbr>").join(text.split(".", 1 if len(text) < LONG_NAME else -1))

    def script(value: Any) -> Markup:
        """Write JSON that cannot end the script element it stands in."""
        text = json.dumps(figure(value), allow_nan=False, separators=(",", ":"))
        return Markup(text.replace("<", "\\u003c"))

    def prose(text: str) -> Markup:
        """Write `code` between backticks as such."""
        code = Markup("<code>{}</code>")
        parts = [
            code.format(part) if i % 2 else escape(signs(part))
            for i, part in enumerate(text.split("`"))
        ]
        return Markup("").join(parts)

    def equation(text: str) -> Markup:
        """Typeset one line of an equation written in plain letters."""
        return Markup("").join(_typeset(piece) for piece in _PIECES.findall(text))

    class Compiled(FileSystemBytecodeCache):
        """The template as code, beside that of the kernels; a page is written without it too."""

        def dump_bytecode(self, bucket: Bucket) -> None:
            with suppress(OSError):
                Path(self.directory).mkdir(parents=True, exist_ok=True)
                super().dump_bytecode(bucket)

    environment = Environment(
        loader=FileSystemLoader(_HERE),
        bytecode_cache=Compiled(str(Path(platformdirs.user_cache_dir("foucault")) / "pages")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "symbol": symbol,
        "dotted": dotted,
        "script": script,
        "prose": prose,
        "equation": equation,
        "seen": seen,
        "still": lambda figure: Markup(svg(figure)),
    }
    return environment.get_template("page.html")
