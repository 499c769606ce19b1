"""The command line, as tests call it."""

from __future__ import annotations

from click.testing import Result
from typer.testing import CliRunner

from foucault.cli import app


def run(*words: object, code: int | None = None, given: bytes | None = None) -> Result:
    """Run the command of these words, which ends with a `code`; what breaks it comes through."""
    result = CliRunner().invoke(app, [str(w) for w in words], input=given)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert code is None or result.exit_code == code, result.output
    return result
