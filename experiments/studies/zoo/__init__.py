"""The zoo of bodies: one filter, one setting, bodies of another's physics. `python -m experiments.studies.zoo`."""
