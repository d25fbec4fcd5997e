"""Zoo study: one filter with one setting on bodies with other physics. `python -m experiments.studies.zoo`."""
