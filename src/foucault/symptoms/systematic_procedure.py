"""What can go wrong in the procedure of systematic calibration, its sequence aside."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("systematic.published", "error",
     "Published steps without a deflection to estimate",
     "steps = \"published\" estimates the deflection in its second step, and deflection is "
     "\"none\".",
     'Take steps = "joint", or choose a model of deflection.'),
    ("systematic.first_part", "error",
     "A session that cannot be cut into the published steps",
     "steps = \"published\" estimates all but the deflection over the first sequence, and the "
     "deflection over those that follow; {what}.",
     'Name at least two sequences, such as sequence = ["19 positions", "spins, simple 6"], or '
     'take steps = "joint", which needs no parts.'),
    ("systematic.no_sequence", "error",
     "A simulation without a sequence",
     "No sequence is declared, so that there is none to simulate.",
     'Name one, such as sequence = ["19 positions"], or list `actions`.'),
    ("systematic.all_move", "error",
     "Rests of which hardly one is still",
     "Of {rests} rests {given} are still; it takes two or more.",
     "Clamp the table, and look for what moves it; look at the log with `foucault inspect`."),
    ("systematic.first_rest", "error",
     "A first rest that is too short to align in",
     "The first rest lasts {time} s; the attitude at the start needs {least} s or more.",
     "Rest a minute or more before the first turn."),
    ("systematic.start_heading", "warning",
     "Biases before the session that leave no heading to start from",
     "By what is known of the biases beforehand the heading at the start is uncertain by {sd} deg, "
     "and the equations are not linear over that.",
     "Subtract a rough gyro bias first and say so in [prior], or do this with gyros that find "
     "north."),
    ("systematic.recognised", "note",
     "A session that is one of the built-in sequences",
     "The turns of the log are those of the sequence '{name}'.",
     "Name it in `sequence`: turns and rests are then compared one by one."),
    ("systematic.unseen", "warning",
     "Coefficients that the sequence does not show",
     "The session tells hardly anything of {names}.",
     "Add {wanted}; or leave out what is not wanted."),
    ("systematic.deflection_unseen", "error",
     "A model of deflection that the session cannot see",
     "The model of deflection '{model}' has {count} parameters, and this session tells {rank} "
     "combinations of them better than 3 arcsec/g. It cannot see: {blind}.",
     "Add {wanted}; or choose a model with fewer parameters (coupled6 is seen whole by the 19 "
     'positions and the six spins); or give what is known of them in [prior] "deflection".'),
    ("systematic.deflection_prior", "warning",
     "Parameters of the deflection that are known only beforehand",
     "Of {count} parameters of the model of deflection '{model}' this session tells {rank} "
     "combinations. Of these only the prior says anything: {blind}.",
     "Add {wanted}; or choose a model with fewer parameters."),
)
# fmt: on
