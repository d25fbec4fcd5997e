"""Assessment: demonstration, benchmark, sweeps and faults. A file for each subcommand."""
