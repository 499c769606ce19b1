"""What can go wrong with a torquing plan, and with a tumble that is simulated."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("torquing.empty", "error",
     "A torquing plan without a step",
     "The torquing plan '{name}' has no steps.",
     'Give a sequence of signed axes such as "-x -z -y +z", or a list of `steps`.'),
    ("torquing.time", "error",
     "A step of a torquing plan that takes no time",
     "{what} of the torquing plan '{name}' takes {given} s.",
     "Give every step a time above zero; `ramp` may be zero."),
    ("torquing.rate", "error",
     "A step of a torquing plan whose rate is not three finite numbers",
     "Step {step} of the torquing plan '{name}' has the rate {given}.",
     'Give three rates, about x, y and z of the cluster, such as ["-0.1 deg/s", "0 deg/s", '
     '"0 deg/s"].'),
    ("torquing.limit", "error",
     "A torquing plan that turns faster than the rig may",
     "Step {step} of the torquing plan '{name}' turns at {given} deg/s about {axis}; the limit is "
     "{limit} deg/s.",
     "Lower the rate and give the step more time, or correct `rate_limit`."),
    ("torquing.sequence", "error",
     "A word of a torquing plan that is no signed axis",
     "'{word}' is neither an axis with its sign nor the name of a torquing plan.{hint}",
     'Write axes with signs, such as "-x -z -y +z", or choose from: {allowed}.'),
    ("torquing.contradiction", "error",
     "A torquing plan that is given twice",
     "[procedure] gives both `{first}` and `{second}`.",
     "Leave one of them out."),
    ("torquing.unused", "error",
     "A setting of a torquing plan that the plan does not take",
     "`{key}` has no place where {what}.",
     "Leave it out, or give the plan as a sequence of axes."),
    ("torquing.no_latitude", "error",
     "A tumble without latitude",
     "The rotation of the Earth turns the cluster by degrees in an hour; without latitude neither "
     "the command nor the motion is known.",
     "Give the latitude in [site]."),
    ("torquing.grade", "error",
     "A class of instruments that clusters do not come in",
     'grade = "{given}" in [simulate]; torqued clusters are drawn as "{allowed}" alone.',
     'Write grade = "{allowed}", and other sizes of single errors in `errors`.'),
    ("torquing.interval", "error",
     "A command that does not change on samples of the log",
     "The command changes every {command} s and a sample is taken every {given} s: that is no "
     "whole number of samples.",
     "Let `command_interval` be a multiple of `interval`."),
    ("torquing.singular", "error",
     "Published integrator on a plan through middle angle 90 deg",
     "{time} s after the start the middle angle came to {given} deg, where the rates of the angles "
     "have no limit.",
     'Take integrator = "exponential", which knows no singular attitude.'),
)
# fmt: on
