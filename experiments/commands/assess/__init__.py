"""Subcommands for assessment: demonstration, benchmark, sweeps and faults."""
