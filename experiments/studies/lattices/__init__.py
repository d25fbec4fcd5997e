"""Study that compares the moduli of spring lattices with the moduli of the same tissue."""
