"""A function for each subcommand, in a file for each kind of task, registered in `app.py`.

Options, calls and printing belong here. Each function imports what it needs when it runs, so that --help is fast.
"""
