"""Command line, scenarios, scripts and plots: everything that uses tissue, filters and pictures together."""
