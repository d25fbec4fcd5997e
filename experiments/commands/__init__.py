"""A file for each subcommand, registered in `app.py`.

What may enter: options, calls, printing. Functions import what they need, so that help is instant.
"""
