"""Study of breathing lungs: inner landmarks from those on the hull. `python -m experiments.studies.lungs FOLDER`."""
