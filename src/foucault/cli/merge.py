"""The command that merges results of one instrument: merge."""

from __future__ import annotations

import typer

from foucault.cli import words
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "merge",
        epilog=words.epilog("foucault merge monday tuesday -o merged", exits=words.VERDICT),
    )(merge)


def merge(
    ctx: typer.Context,
    results: words.ResultFiles,
    output: words.RunFolder,
) -> None:
    """Merge results of one instrument from different logs into one.

    Weighted by their whole covariance; whether they agree is checked.
    """
    from foucault import report, run_folder
    from foucault.campaign import earlier
    from foucault.files import alone, beside

    screen: Screen = ctx.obj
    result = earlier.merge(results)
    with alone(output):
        run_folder.save(result, output)
        with beside(output):
            file = report.write(output)
    level = result.verdict.level
    screen.say("", result.coefficients)
    screen.findings(result.findings)
    screen.say(*(f"  {check.sentence}" for check in result.checks))
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(f"Report: {file}")
    screen.data({
        "folder": str(output), "report": str(file), "verdict": level,
        "checks": [{"name": c.name, "value": None if c.value != c.value else c.value,
                    "passed": c.passed} for c in result.checks],
        "coefficients": result.coefficients.rows(),
    })  # fmt: skip
    raise typer.Exit(EXIT_CODES[level])
