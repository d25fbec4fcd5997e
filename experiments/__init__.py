"""The programs that combine tissue, filters and vision: command line, files, simulation, studies and plots."""
