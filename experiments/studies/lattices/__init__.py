"""Moduli of lattices of springs, beside those of the tissue that they stand for."""
