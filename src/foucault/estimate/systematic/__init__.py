"""Every instrument error from velocities at rest."""
