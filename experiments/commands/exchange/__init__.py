"""Subcommands for exchange with other programs: export of recordings, import of tables."""
