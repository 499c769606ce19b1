"""What can go wrong when a plan is judged before the session."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("preflight.simulated", "note",
     "A preflight by one simulated session",
     "{procedure} plans no motion of its own: one session was simulated as [simulate] says and "
     "calibrated. Its noise, an instrument of class {grade} and what was drawn decide too.",
     "`foucault montecarlo` shows the spread over instruments and noise."),
    ("preflight.typical", "note",
     "A preflight without the noise of the instrument",
     "[noise] does not say the noise of the instrument, which a calibration measures in the log; "
     "that of the class {grade} in [simulate] was taken.",
     "Give it in [noise] if it is known: uncertainties depend on it."),
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
