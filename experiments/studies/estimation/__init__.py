"""Estimation study: hundreds of seeded runs on the phantom, and the page with their results."""
