"""What can go wrong with a plan for north seeking."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("north_plan.gyro", "error",
     "A plan for north seeking without the noise of the gyro",
     "{given} how noisy the gyro is; exactly one has to.",
     "Give --gyro-noise \"0.003 deg/sqrt(h)\", its angle random walk, or --gyro-noise with one of "
     "{grades}, or --noise with a campaign file that has [noise]. `foucault allan` measures it."),
    ("north_plan.no_noise", "error",
     "A plan for north seeking with a gyro that has no white noise",
     "The angle random walk of the gyro is {given}; a plan needs one above zero.",
     "Measure it with `foucault allan`, or take it from the data sheet."),
    ("north_plan.noise_option", "error",
     "Noise of a plan for north seeking that is given twice",
     "{option} and --noise both say how noisy the instrument is.",
     "Write it into [noise] of the campaign file, or leave --noise out."),
    ("north_plan.wanted", "error",
     "A plan for north seeking without accuracy and without time",
     "Neither the wanted accuracy nor the time there is was given.",
     "Give --accuracy \"0.1 deg\" (one standard deviation), --time \"10 min\", or both."),
    ("north_plan.range", "error",
     "A value of a plan for north seeking that cannot be",
     "{option} is {given}; it must be {allowed}.",
     "Give another value."),
    ("north_plan.order", "error",
     "An order of stops that does not exist",
     "'{name}' is not an order of stops.{hint}",
     "Choose from: {allowed}."),
    ("north_plan.positions", "error",
     "Fewer than two positions",
     "{given} positions cannot tell the rate of the Earth from the offset of the gyro.",
     "Take at least two (the east-west pair), better four."),
    ("north_plan.count", "error",
     "No turn, or no cycle",
     "{given} {what}: at least one is needed.",
     "Give 1 or more."),
    ("north_plan.no_stops", "error",
     "A file of stops for a base that turns all the time",
     "'{name}' has no stops to write.",
     "Choose an order of stops with --order, or turn the base as the plan says."),
    ("north_plan.too_short", "error",
     "Too little time for any order of stops",
     "In {given} no order has the time for its moves and for stops of {stop}; the quickest of "
     "them takes {least}.",
     "Give more time, or a shorter --move."),
    ("north_plan.dwell_short", "warning",
     "Stops too short for the wanted accuracy",
     "In {minutes} minutes, {stop}, the heading is good to {sd}; wanted is {accuracy}.",
     "{cure}"),
    ("north_plan.gyro_noisy", "warning",
     "A gyro too noisy to see the Earth's rate",
     "In {minutes} minutes the noise of the measured rate is {ratio} of the horizontal part of the "
     "Earth's rate; for a heading it may be a third at most: too noisy by a factor of {factor}.",
     "Take a better gyro, or average {longer} times as long if its noise is white."),
)
# fmt: on
