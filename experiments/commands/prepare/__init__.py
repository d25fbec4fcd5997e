"""Before anything is estimated: recordings simulated or filmed, cameras calibrated, hues learned.

A file for each subcommand.
"""
