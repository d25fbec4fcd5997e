"""Study of a new user's steps with own phantoms, and reliability of probabilities; `__main__` has the command."""
