"""Command line, scenarios, scripts and plots: the code that combines tissue, filters and vision."""
