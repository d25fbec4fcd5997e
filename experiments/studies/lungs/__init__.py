"""Breathing lungs: landmarks inside estimated from those on the hull. `python -m experiments.studies.lungs FOLDER`."""
