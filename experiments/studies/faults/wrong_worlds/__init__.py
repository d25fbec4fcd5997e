"""Study of worlds that differ from the stated scene, and of wrong GO there; `__main__` has the command."""
