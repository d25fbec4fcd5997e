"""Checked files: scenes, recordings, scenarios, needles, plans, tables.

Another format belongs here, written with `outputs.py`.
"""
