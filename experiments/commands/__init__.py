"""One function per subcommand, registered in `app.py`; one file per kind of task.

Options, calls and printing belong here. Each function imports what it needs when it runs, so that --help is fast.
"""
