"""The command line: a file for each subcommand, registered in `app.py`.

What may enter: options, what is called, what is printed. Imports stand inside functions, so that help is instant.
"""
