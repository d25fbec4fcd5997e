"""Subcommands for preparation: projects, simulations, recordings, calibration and registration, hues."""
