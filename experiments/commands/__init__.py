"""A file for each subcommand, registered in `app.py`.

Options, calls and printing belong here. Functions import what they need when they run, so that help appears at once.
"""
