"""The steps of a new user on phantoms of their own, and whether probabilities come true; `__main__` has the command."""
