"""Rows of the table about what ends a command whatever it does: memory, files, faults."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("program.memory", "error",
     "More is asked for than fits into memory",
     "There is not enough memory for this: {reason}.",
     "Ask for less: a shorter or slower session, fewer instruments or trials, a part of the log."),
    ("program.nested", "error",
     "A file that is nested without end",
     "Something in a file that was given is nested too deeply to be read.",
     "Look at the files: tables and lists go a few levels deep, no more."),
    ("program.file", "error",
     "A file that the system cannot open, or a name that is none",
     "'{path}' cannot be used: {reason}.",
     "Give the name of a file that exists and that you may read."),
    ("program.fault", "error",
     "A fault in foucault itself",
     "foucault failed with {kind} ({reason}) in {where}. This is a fault in foucault, not in what "
     "was given.",
     "Please report it with the input, and with what is kept in '{file}'."),
    ("program.samples", "error",
     "A session planned that is too large to simulate",
     "The session that is planned has {count:.3g} samples, about {size:.3g} GB; at most {most} are "
     "simulated.",
     "Plan a shorter session or a lower rate."),
    ("program.few", "error",
     "A session planned that is over before its second sample",
     "The session that is planned is shorter than the time between two samples.",
     "Plan a longer session or a higher rate."),
    ("program.count", "error",
     "A count that no session has",
     "{key} = {given} is more than any session has; at most {most} are taken.",
     "Give the number that is meant."),
)
# fmt: on
