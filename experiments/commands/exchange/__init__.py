"""Exchange with other programs: exporting recordings, importing tables of trackers. A file for each subcommand."""
