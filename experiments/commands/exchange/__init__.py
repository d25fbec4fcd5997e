"""To and from other programs: recordings exported, tables of other trackers imported. A file for each subcommand."""
