"""Study of the moduli of spring lattices, in comparison with those of their tissue."""
