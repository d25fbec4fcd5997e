"""Everything that uses tissue, filters and pictures together: the command line, scenarios, scripts, plots."""
