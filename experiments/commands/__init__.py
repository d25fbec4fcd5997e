"""A function for each subcommand, in a file for each kind of task, registered in `app.py`.

Options, calls and printing belong here. Functions import what they need when they run, so that help appears at once.
"""
