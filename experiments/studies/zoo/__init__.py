"""Study of the filter with the same settings on many different bodies; `__main__` has the command."""
