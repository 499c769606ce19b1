"""The words of the command line: options that several commands share, examples, exit codes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

VERDICT = {0: "pass", 3: "doubtful", 4: "unusable"}
"""Exit codes of a command that ends with a verdict."""

# -- what is given -------------------------------------------------------------------------

CampaignFile = Annotated[Path, typer.Argument(help="A campaign file.")]
CampaignOrName = Annotated[
    str, typer.Argument(help="A campaign file, or the name of a procedure, such as hand_rotated.")
]
SearchedOrName = Annotated[
    str,
    typer.Argument(
        help="A campaign file, or the name of a procedure whose plan can be searched for: "
        "norm_observation, multi_position, turntable, north_seeking, platform_tumble, "
        "systematic, transfer_alignment."
    ),
]
LogFile = Annotated[
    Path,
    typer.Argument(
        help="A log that foucault has written, one whose titles give the units, gyro_x (deg/s), "
        "or a campaign file that describes it."
    ),
]
ResultFile = Annotated[Path, typer.Argument(help="A run folder or its result.json.")]
ResultFiles = Annotated[list[Path], typer.Argument(help="Run folders or their result.json.")]

Calibration = Annotated[
    Path | None,
    typer.Option(help="Run folder of `foucault calibrate`, or its result.json; none if left out."),
]
Tolerance = Annotated[
    Path | None,
    typer.Option(help="TOML file with the limits of coefficients; none if left out."),
]
Serial = Annotated[
    str, typer.Option(help="Serial number of the instrument, compared with the calibration.")
]
SITE = (
    "Site and noise that are left out are those of the campaign, where the log is one; otherwise "
    "the height is 0 m and gravity is normal gravity there."
)
"""Note of commands that take a site and noise."""

Gaps = Annotated[
    Literal["stop", "bridge"], typer.Option(help="What to do where samples are missing.")
]
Seed = Annotated[int, typer.Option(help="Seed of the random numbers.", min=0)]

# -- quantities ----------------------------------------------------------------------------

Latitude = Annotated[
    str | None, typer.Option(help='Latitude of the site, positive north, such as "47.3 deg".')
]
LatitudeSd = Annotated[
    str | None, typer.Option(help='Standard deviation of the latitude, such as "0.5 deg".')
]
Height = Annotated[str | None, typer.Option(help='Height of the site, such as "430 m".')]
Gravity = Annotated[str | None, typer.Option(help='Local gravity, such as "9.8072 m/s^2".')]
GyroNoise = Annotated[
    str | None, typer.Option(help='Angle random walk of the gyros, such as "0.003 deg/sqrt(h)".')
]
AccelNoise = Annotated[
    str | None,
    typer.Option(help='Velocity random walk of the accelerometers, such as "30 ug/sqrt(Hz)".'),
]
IndexSd = Annotated[
    str | None, typer.Option(help='Standard deviation of every index angle, such as "10 arcsec".')
]
SeekerLevelSd = Annotated[
    str | None,
    typer.Option(
        "--level-sd",
        help='Without accelerometers: how well the case is levelled, such as "1 arcmin".',
    ),
]
UnknownLatitude = Annotated[
    bool, typer.Option("--unknown-latitude", help="The readings have to tell the latitude too.")
]
Accuracy = Annotated[
    str | None, typer.Option(help='Wanted standard deviation of the heading, such as "0.1 deg".')
]
From = Annotated[
    str | None,
    typer.Option(
        "--from", help='Use the log from here on, such as "600 s"; times count from its start.'
    ),
]
Until = Annotated[str | None, typer.Option(help='Use the log up to here, such as "90 min".')]

# -- what is written -----------------------------------------------------------------------


def _folder(path: Path | None) -> Path | None:
    """Refuse a folder that cannot be made, before the work and not after it."""
    from foucault.files import unwritable

    if path is None:
        return None
    try:
        above = (path.absolute(), *path.absolute().parents)
        there = next((p for p in above if p.exists()), above[-1])
        if not (there.is_dir() and os.access(there, os.W_OK)):
            raise NotADirectoryError(f"'{there}' is not a folder that can be written to")
    except OSError as problem:
        raise unwritable(path, problem) from None
    return path


def _file(path: Path | None) -> Path | None:
    """Refuse a file whose folder is not there, before the work and not after it."""
    from foucault.files import unwritable

    if path is not None and not path.absolute().parent.is_dir():
        raise unwritable(path, FileNotFoundError("its folder is not there"))
    return path


def _folder_option(text: str) -> Any:
    return typer.Option("-o", "--output", callback=_folder, help=text)


Folder = Annotated[Path, _folder_option("Folder to write.")]
RunFolder = Annotated[Path, _folder_option("Folder to write; a result in it is replaced.")]
ContinuedFolder = Annotated[Path, _folder_option("Folder to write; work begun in it is continued.")]
FolderIfWanted = Annotated[Path | None, _folder_option("Folder to write; none if left out.")]
TableIfWanted = Annotated[
    Path | None,
    typer.Option("-o", "--output", callback=_file, help="CSV file to write; none if left out."),
]


def epilog(*examples: str, notes: str = "", exits: Mapping[int, str] | None = None) -> str:
    """Return what stands below the options: examples, notes, the meaning of exit codes.

    Parameters
    ----------
    *examples : str
        Complete command lines; all after the last `>` or `|` must be commands of this program.
    notes : str, optional
        A paragraph in between.
    exits : Mapping, optional
        What each exit code means beyond those of every command.

    Returns
    -------
    str
        Text for the epilog of a command.
    """
    title = "Example" if len(examples) == 1 else "Examples"
    parts = ["\n".join(["\b", f"{title}:", *(f"  {line}" for line in examples)])]
    parts += [notes] if notes else []
    if exits:
        lines = [f"  {code:<3} {meaning}" for code, meaning in exits.items()]
        parts.append("\n".join(["\b", "Exit codes:", *lines]))
    return "\n\n".join(parts)
