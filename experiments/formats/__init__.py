"""Reads, checks and writes files: scenes, recordings, scenarios, needles, plans, tables.

A new format belongs here; it is written with `outputs.py`.
"""
