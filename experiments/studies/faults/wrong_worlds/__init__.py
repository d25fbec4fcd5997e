"""Study of wrong advice GO in worlds that differ from the stated scene; `__main__` has the command."""
