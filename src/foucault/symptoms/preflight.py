"""What can go wrong when a plan is judged before the session."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("preflight.procedure", "error",
     "A preflight of a procedure that plans no motion",
     "What {procedure} will show cannot be predicted from its campaign.",
     "It can be of: {able}. Otherwise simulate a session and calibrate it: foucault simulate."),
    ("preflight.unseen", "warning",
     "Coefficients that a planned motion will hardly show",
     "{count} coefficients will be known hardly better than before: {names}.",
     "Turn through more orientations, about more axes, or longer; --plan and --rate try another "
     "plan. A calibration of this one may not converge, and the other uncertainties hold only "
     "near the errors that were thought usual."),
    ("preflight.noise", "note",
     "A preflight without noise of the accelerometers",
     "[noise] does not say the white noise of the accelerometers, which a calibration measures in "
     "the log; {given} ug/sqrt(Hz) was taken.",
     "Give it in [noise.accel] if it is known: uncertainties depend on it."),
    ("preflight.filter", "note",
     "A preflight of a published filter",
     "The uncertainties are those of gauss-newton, which come to the bound; those that the "
     "{filter} filter states are smaller, and its errors larger.",
     'Take filter = "gauss-newton".'),
)
# fmt: on
