"""Ablation study: benefit of each mechanism of the filter, from runs without the mechanism; command: see `__main__`."""
