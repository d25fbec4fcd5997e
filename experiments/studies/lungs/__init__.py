"""Breathing lungs: inner landmarks estimated from those on the hull. `python -m experiments.studies.lungs FOLDER`."""
