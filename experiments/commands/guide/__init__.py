"""Subcommands for the needle: advice, planning, and simulated insertion."""
