"""Zoo study: one filter with the same settings on different bodies; `__main__` has the command."""
