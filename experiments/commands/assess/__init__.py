"""What it is worth: the demonstration and the benchmark. A file for each subcommand."""
