"""Zoo study: one filter with one setting on bodies of another physics. `python -m experiments.studies.zoo`."""
