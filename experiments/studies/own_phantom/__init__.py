"""The steps of a new user on phantoms of their own, and the reliability of probabilities; `__main__` has the command."""
