"""Ablation study: benefit of each mechanism of the filter, from runs without it; `__main__` has the command."""
