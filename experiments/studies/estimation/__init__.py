"""Estimation studies: hundreds of seeded runs on the phantom."""
