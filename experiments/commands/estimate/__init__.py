"""From marks to the target: tracking recordings and live sources, identifying constants and noise levels.

A file for each subcommand.
"""
