"""From the target to the needle: advice, planning, closed-loop insertion. A file for each subcommand."""
