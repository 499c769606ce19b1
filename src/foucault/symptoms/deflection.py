"""Rows of the table about the deflection of dithered gyros."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("deflection.model", "error",
     "An unknown model of deflection",
     "There is no model of deflection '{name}'.{hint}",
     "Models are: {allowed}."),
    ("deflection.twice", "error",
     "A model of deflection beside coefficients that it is made of",
     "The states hold {given} already, and the parameters of the model of deflection '{name}' are "
     "sums of such coefficients: nothing could tell them apart.",
     "Take the model, or single coefficients of gyro.deflection. A group such as \"gyro\" holds "
     "them all: name gyro.bias, gyro.scale and what else is wanted."),
    ("deflection.chirality", "error",
     "A sense of the dither wheel that is none",
     "The chirality of a dither wheel is {given}; it must be -1 or 1.",
     "Leave it at -1, and try 1 where the likelihood of the log is to decide."),
)
# fmt: on
