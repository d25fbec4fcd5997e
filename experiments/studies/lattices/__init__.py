"""Study that compares the moduli of spring lattices with those of their tissue."""
