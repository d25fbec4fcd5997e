"""Subcommands that estimate the target, or the constants and noise levels of the model."""
