"""A new user's steps on phantoms of their own, and the reliability of probabilities; `__main__` has the command."""
