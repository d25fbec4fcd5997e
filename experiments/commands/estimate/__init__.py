"""From marks to the target: recordings and live sources tracked, constants and noise levels identified.

A file for each subcommand.
"""
