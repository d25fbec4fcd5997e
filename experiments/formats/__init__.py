"""Checked files: scenes, recordings, scenarios, needles, plans, tables.

What may enter: another format, written by `outputs.py`.
"""
