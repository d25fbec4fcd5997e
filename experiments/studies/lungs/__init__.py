"""Study of breathing lungs: inner landmarks by those on the hull. `python -m experiments.studies.lungs FOLDER`."""
