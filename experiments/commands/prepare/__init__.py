"""Preparation: making projects, simulating or filming recordings, calibrating cameras, learning hues.

A file for each subcommand.
"""
