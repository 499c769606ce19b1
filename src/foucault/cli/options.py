"""Options with a unit, and options made from the fields of settings, so that each is stated once.

A quantity is text with its unit on the command line and a number in SI in the command. A parameter
`Annotated[Any, Of("module:Model")]` stands for the settings of a model: an option for each field,
with its unit, bounds, description and default, of which the command gets what was given. Models are
imported when the options of their command are looked at, which no other command does.
"""

from __future__ import annotations

import inspect
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer
from typer.core import TyperCommand
from typer.main import get_command

from foucault.errors import error
from foucault.files import unwritable

if TYPE_CHECKING:
    from foucault.errors import FoucaultError

    Amount = Any
else:
    Amount = str
"""A quantity: text on the command line, a number in the command."""

KEYWORD_ONLY = inspect.Parameter.KEYWORD_ONLY

Command = TypeVar("Command", bound=Callable[..., Any])
Least = Literal["", "greater than 0", "0 or more"]


def read(option: str, text: str, kind: str, least: Least = "") -> float:
    """Return the number that an option says [SI]; a mistake names the option."""
    from foucault.campaign.tables import parse_at
    from foucault.units import SMALLEST

    value = parse_at(option, text, kind)
    fine = {"greater than 0": value > 0, "0 or more": value >= 0}.get(least, True)
    wrong: str = "" if fine else least
    if value and not SMALLEST < abs(value) < 1 / SMALLEST:
        wrong = "of a size that something has"
    if wrong:
        raise error("campaign.value", key=option, given=repr(text), hint="", more="",
                    reason=f"it should be {wrong}")  # fmt: skip
    return value


def quantity(kind: str, said: str, *names: str, least: Least = "") -> Any:
    """Return an option that holds a quantity of a kind; `said`: its help, if not in `help.toml`."""

    def parsed(param: typer.CallbackParam, value: str | None) -> Any:
        return None if value is None else read(param.opts[-1], value, kind, least)

    return typer.Option(*names, callback=parsed, help=said)


@dataclass(frozen=True)
class Several:
    """Quantities of one kind in one option, as in `example`: "0 s to 300 s", "1 m/s, 2 m/s"."""

    kind: str
    what: str  # they say, in words
    example: str

    def read(self, option: str, text: str) -> tuple[float, ...]:
        """Return what an option says [SI]; a mistake names the option."""
        from foucault.campaign.tables import parse_at

        between = " to " if " to " in self.example else ","
        parts = text.split(between)
        if len(parts) != len(self.example.split(between)):
            raise self.refused(option, text)
        return tuple(parse_at(option, one.strip(), self.kind) for one in parts)

    def refused(self, option: str, text: str) -> FoucaultError:
        """Return the error of an option that does not say what it should."""
        words = {"what": self.what, "example": self.example}
        return error("program.parts", option=option, given=text, **words)

    def option(self, said: str) -> Any:
        """Return an option that holds them, or one that may be repeated; `said` is its help."""

        def parsed(param: typer.CallbackParam, value: Any) -> Any:
            if value is None or isinstance(value, str):
                return None if value is None else self.read(param.opts[-1], value)
            return [self.read(param.opts[-1], one) for one in value]

        return typer.Option(callback=parsed, metavar="<str>", help=said)


REST = Several("time", "when it starts and when it ends", "0 s to 300 s")
"""A rest, in times that count from the start of the log."""


# -- settings ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Of:
    """The fields of a model of settings as options."""

    model: str  # where it is: "module:Model"
    only: tuple[str, ...] = ()  # fields that have an option; none for all
    called: Mapping[str, str] = field(default_factory=dict)  # field -> option that differs from it
    above: tuple[str, ...] = ()  # fields that may be zero, though to give zero says nothing
    over: bool = False  # they go before what a campaign says: what is left out has no default

    @property
    def fields(self) -> dict[str, Any]:
        """The fields that have an option, by name."""
        every = self.settings.model_fields
        return {key: every[key] for key in self.only or every}

    @property
    def settings(self) -> Any:
        """The model itself."""
        module, _, name = self.model.partition(":")
        return getattr(import_module(module), name)

    def option(self, name: str) -> str:
        """Return the option of a field."""
        return "--" + self.called.get(name, name).replace("_", "-")

    def parameters(self) -> list[inspect.Parameter]:
        """Return a parameter for each field, as a command has it."""
        from foucault.campaign.tables import kind_of
        from foucault.strict import description_of

        out = []
        for key, info in self.fields.items():
            kind = kind_of(info)
            said = with_example(description_of(self.settings, key), info, kind)
            option = typer.Option(self.option(key), help=said)
            kept = (info.annotation, info.default) if kind is None else (str | None, None)
            kept = (str, inspect.Parameter.empty) if info.is_required() else kept
            if self.over and info.annotation is not bool:
                kept = (kept[0] | None, None)
            out.append(
                inspect.Parameter(
                    key, KEYWORD_ONLY, default=kept[1],
                    annotation=Annotated[kept[0], option],
                )
            )  # fmt: skip
        return out

    def taken(self, given: dict[str, Any]) -> dict[str, Any]:
        """Take what was given of the fields out of the arguments of a command [SI]."""
        from foucault.campaign.tables import kind_of

        out = {}
        for key, info in self.fields.items():
            value, kind = given.pop(key), kind_of(info)
            if value is not None and kind is not None:
                bounds = {type(mark).__name__ for mark in info.metadata}
                least: Least = "0 or more" if "Ge" in bounds else ""
                least = "greater than 0" if "Gt" in bounds or key in self.above else least
                value = read(self.option(key), value, kind, least)
            if value is not None and not (self.over and value is False):
                out[key] = value
        return out


def with_example(said: str, info: Any, kind: str | None) -> str:
    """Return the description of a field, with an example of what to write where it has none."""
    from foucault.units import KINDS

    for group in ("Fix. ", "Planning. ", "Calibration. "):
        said = said.removeprefix(group)
    if kind is None or '"' in said:
        return said
    example = info.examples[0] if info.examples else KINDS[kind].example
    ends = [at for mark in ".;" if (at := said.find(mark)) >= 0]
    return f'{said[: min(ends)]}, such as "{example}"{said[min(ends) :]}'


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with its screen, and an option for each field in place of its settings."""
    groups: dict[str, Of] = {}
    parameters = [inspect.Parameter("ctx", KEYWORD_ONLY, annotation=typer.Context)]
    known = inspect.signature(function, eval_str=True).parameters
    for parameter in known.values():
        marks = getattr(parameter.annotation, "__metadata__", ())
        of = next((mark for mark in marks if isinstance(mark, Of)), None)
        if of is not None:
            groups[parameter.name] = of
            parameters += of.parameters()
        elif parameter.name not in ("ctx", "screen"):
            parameters.append(parameter.replace(kind=KEYWORD_ONLY))

    def called(ctx: typer.Context, **given: Any) -> Any:
        import numpy as np

        vars(np).setdefault("f2py", None)  # SciPy loads all that NumPy names, compilers included
        of_all = {"ctx": ctx, "screen": ctx.obj}
        given |= {name: of.taken(given) for name, of in groups.items()}
        return function(**given, **{name: of_all[name] for name in of_all if name in known})

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return called


def command(
    *examples: str, notes: str = "", exits: Mapping[int, str] | None = None
) -> Callable[[Command], Command]:
    """Give a function what `add` takes to make it a command; the arguments are of `epilog`."""

    def marked(function: Command) -> Command:
        function.epilog = epilog(*examples, notes=notes, exits=exits)  # type: ignore[attr-defined]
        return function

    return marked


@cache
def _helps() -> dict[str, dict[str, dict[str, str]]]:
    """Return what the arguments and options are for, by module, command and name."""
    return tomllib.loads(Path(__file__).with_name("help.toml").read_text(encoding="utf-8"))


def add(
    app: typer.Typer, function: Callable[..., Any], kind: type[TyperCommand] = TyperCommand,
    **more: Any,
) -> None:  # fmt: skip
    """Add a command to the program; its options are made when it is looked at or called."""

    @cache
    def made() -> Any:
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command()(plain(function))
        command: Any = get_command(alone)
        module, name = function.__module__.rpartition(".")[2], function.__name__.rstrip("_")
        words = _helps().get(module, {}).get(name, {})
        for param in command.params:
            param.help = words.get(param.name, param.help)
        return command

    class Late(kind):  # type: ignore[misc, valid-type]
        """A command without its options, which are those of `made`."""

        params = property(lambda self: made().params, lambda self, value: None)
        callback = property(lambda self: made().callback, lambda self, value: None)

    def stub() -> None: ...

    stub.__doc__ = function.__doc__
    epilog = function.epilog  # type: ignore[attr-defined]
    app.command(function.__name__.rstrip("_"), cls=Late, epilog=epilog, **more)(stub)


def epilog(*examples: str, notes: str = "", exits: Mapping[int, str] | None = None) -> str:
    """Return what stands below the options of a command.

    `examples`: complete command lines, all after the last `>` or `|` must be commands of this
    program; `notes`: a paragraph in between; `exits`: what exit codes mean, beyond those of all.
    """
    title = "Example" if len(examples) == 1 else "Examples"
    parts = ["\n".join(["\b", f"{title}:", *(f"  {line}" for line in examples)])]
    parts += [notes] if notes else []
    if exits:
        lines = [f"  {code:<3} {meaning}" for code, meaning in exits.items()]
        parts.append("\n".join(["\b", "Exit codes:", *lines]))
    return "\n\n".join(parts)


# -- The words of the command line: arguments and options that several commands share ------------

VERDICT = {0: "pass", 3: "doubtful", 4: "unusable"}
"""Exit codes of a command that ends with a verdict."""

FRAMES = "Frames: a name of `foucault capture --list`, or a file that describes them."
For = Annotated[Amount | None, quantity("time", "", "--for", least="greater than 0")]
Silence = Annotated[
    Amount | None,
    quantity("time", 'End when nothing comes for so long, such as "5 s".', least="greater than 0"),
]

# -- what is given -------------------------------------------------------------------------

CampaignFile = Annotated[Path, typer.Argument(help="A campaign file.")]
CampaignOrLogs = Annotated[
    list[Path] | None,
    typer.Argument(
        help="A campaign file; or a log without one, in one file or in several recorded together, "
        "such as one of accelerometers and one of gyros."
    ),
]
CampaignOrName = Annotated[
    str, typer.Argument(help="A campaign file, or the name of a procedure, such as hand_rotated.")
]
SearchedOrName = Annotated[
    str,
    typer.Argument(
        help="A campaign file, or the name of a procedure whose plan can be searched for: "
        "rate_table, norm_observation, multi_position, turntable, north_seeking, platform_tumble, "
        "systematic, transfer_alignment, continuous_spin, six_position, ferraris."
    ),
]
LogFile = Annotated[
    Path,
    typer.Argument(
        help="A log that foucault has written, one whose titles give the units, gyro_x (deg/s), "
        "or a campaign file that describes it."
    ),
]
LogFiles = Annotated[
    list[Path],
    typer.Argument(
        help="A log, in one file or in several recorded together, such as one of accelerometers "
        "and one of gyros; or a campaign file that describes it."
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
SAID = "foucault.campaign.tables:Said"  # What is said beside a log.

Place = Annotated[Any, Of(SAID, ("latitude", "height", "gravity"), over=True)]
"""What no log can say."""
Taken = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="<str>",
        help="A key of [log], for a log without a campaign, such as gyro.unit = deg/s or rate = "
        "100 Hz; may be repeated.",
    ),
]


SaidOfCampaign = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="<str>",
        help="A key of the campaign with its table, such as procedure.held_out = 3 or "
        "simulate.rests = 12; may be repeated.",
    ),
]
TermsChosen = Annotated[
    Literal["auto", "as set"] | None,
    typer.Option(
        "--terms",
        help="Optional terms: auto estimates those that the log tells better than their size, "
        "as set what [procedure] says.",
    ),
]


def bare(paths: Sequence[Path]) -> bool:
    """Tell whether what is given is a log, and no campaign file."""
    return len(paths) > 1 or paths[0].suffix.lower() != ".toml"


def known(paths: Sequence[Path], taken: Sequence[str] | None) -> dict[str, Any]:
    """Return the keys of [log] that were said of a bare log."""
    from foucault.campaign.recognised import said_of

    if not bare(paths):
        refuse_beside({}, taken)
    return said_of(taken or ())


def refuse_beside(place: Mapping[str, Any], taken: Sequence[str] | None) -> None:
    """Refuse to say beside a campaign what it says itself."""
    if place or taken:
        given = [f"--{key}" for key in place] + ["--set"] * bool(taken)
        raise error("recognise.beside", given=", ".join(given))


SITE = (
    "Site and noise that are left out are those of the campaign, where the log is one; otherwise "
    "the height is 0 m and gravity is normal gravity there."
)
"""Note of commands that take a site and noise."""

Seed = Annotated[int, typer.Option(help="Seed of the random numbers.", min=0)]

# -- what is written -----------------------------------------------------------------------


def _folder(path: Path | None) -> Path | None:
    """Refuse a folder that cannot be made, before the work and not after it."""
    if path is None:
        return None
    try:
        above = (path.absolute(), *path.absolute().parents)
        there = next((p for p in above if p.exists() or p.is_symlink()), above[-1])
        if not (there.is_dir() and os.access(there, os.W_OK)):
            raise NotADirectoryError(f"'{there}' is not a folder that can be written to")
    except OSError as problem:
        raise unwritable(path, problem) from None
    return path


def _file(path: Path | None) -> Path | None:
    """Refuse a file whose folder is not there, before the work and not after it."""
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
ListIfWanted = Annotated[
    Path | None,
    typer.Option(
        "--steps", callback=_file,
        help="Page to write with the positions in order, for the operator; none if left out.",
    ),
]  # fmt: skip
